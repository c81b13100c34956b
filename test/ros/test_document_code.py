"""Every code block of README and docs runs as it stands.

A block that cannot run here begins with a comment that says what it needs. Servos are no such need:
simulated ones of the robot that the block names stand behind /dev/ttyUSB0. What an earlier
block has run is not run again.
"""

import ast
import os
import re
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from textwrap import dedent

import pytest
import yaml
from program_names import NODES
from ros_domain import own_domain

from head_tracking.configuration import configured_head
from head_tracking.configuration.simulated import mounted_servos
from head_tracking.run.options import parse_arguments
from head_tracking.share import robot_parameters
from head_tracking.simulation import SimulatedPort

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
NEEDS = re.compile(r"# Needs [\w ]+")
PORT = "/dev/ttyUSB0"
PATIENCE = 180  # s; other tests may keep the machine busy
LONG = re.compile(r"^(\./scripts/run|ros2 run head_tracking( head_tracking)?|head_tracking) ")
STAND_IN = Path(__file__).parents[1] / "support" / "document_commands.py"


def blocks(language: str) -> list[pytest.param]:
    """Return the blocks in a language, named by document and line."""
    return [
        pytest.param(
            dedent(match[3]), id=f"{path.relative_to(ROOT)}:{text[: match.start()].count(chr(10))}"
        )
        for path in DOCUMENTS
        for text in [path.read_text()]
        for match in BLOCK.finditer(text)
        if match[2] == language
    ]


def cannot_run(code: str) -> bool:
    return NEEDS.match(code) is not None


@contextmanager
def servos(code: str, robot: str) -> Iterator[str]:
    """Serve simulated servos of a robot, and name their port in the code."""
    if PORT not in code:
        yield code
        return
    configured = configured_head(robot_parameters(robot)).servos
    with SimulatedPort(mounted_servos(configured), paced=True) as simulated:
        yield code.replace(PORT, simulated.port_name)


def run(command: list[str], folder: Path, domain: str) -> None:
    (folder / "urdf").symlink_to(ROOT / "urdf")
    programs = folder / "bin"
    programs.mkdir()
    for name in ("head_tracking", "ros2"):
        (programs / name).write_text(
            f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {STAND_IN} {name} "$@"\n'
        )
        (programs / name).chmod(0o755)
    environment = os.environ | {
        "PATH": f"{programs}:{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.getenv("PYTHONPATH")])),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": domain,
        "HOME": str(folder),
    }
    answer = subprocess.run(
        ["env", "--default-signal", *command],
        check=False,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=PATIENCE,
    )
    assert answer.returncode == 0, answer.stdout


def lines(code: str) -> Iterator[str]:
    """Yield the lines of a block without comments."""
    for line in code.replace("\\\n", " ").splitlines():
        yield line.partition(" #")[0].rstrip()


def robot_of(code: str) -> str:
    """Return the name of the robot that a block is for."""
    named = re.search(r'robot[= ]"?([a-z]\w+)', code)
    return named[1] if named else "kinectbot"


def steps(line: str) -> set[str]:
    """Return what a line tries: each option of a run of the head, or else a program with options.

    Values do not count, but a robot does; parameters have a test of their own.
    """
    words = LONG.sub("", line).partition(" --ros-args")[0]
    if words == line or words.endswith("&"):
        return set()
    if words.startswith("-"):
        return set(re.findall(r"--robot \S+|--[a-z-]+", words))
    return {re.sub(r" (\d|/)\S*", "", words)}


def blocks_with_news() -> Iterator[pytest.param]:
    """Yield the blocks of commands, each with the lines that an earlier block has not tried."""
    # by test/calibration and test/contract
    tried = {"calibrate camera --sim --yes --output calibration.yaml", "--target", *NODES}
    for block in blocks("bash"):
        (code,) = block.values
        new = []
        for line in lines(code):
            found = set() if cannot_run(code) else steps(line)
            if not found or not found <= tried:
                new.append(line)
            tried |= found
        yield pytest.param(code, new, id=block.id)


def commands(new: list[str]) -> Iterator[str]:
    """Yield the commands of a block; those in the background end with it."""
    yield "trap 'kill $(jobs -p) 2>/dev/null || true; wait || true' EXIT"
    for words in new:
        if LONG.match(words) and words.endswith("&"):
            yield f"timeout --kill-after 20 {PATIENCE} {words}"  # the shell lets it ignore SIGINT
        elif LONG.match(words):
            # beside other work simulated servos may answer late, and doctor counts that
            yield f"until {words}; do sleep 1; done" if " doctor " in words else words
        else:
            yield words


@pytest.mark.parametrize("code", blocks("python"))
def test_python(code: str, tmp_path: Path) -> None:
    if cannot_run(code):
        ast.parse(code)
        return
    with ExitStack() as stack:
        domain = stack.enter_context(own_domain())
        code = stack.enter_context(servos(code, robot_of(code)))
        (tmp_path / "program.py").write_text(code)
        end = "timeout --signal TERM --kill-after 20 4" if "rclpy.spin" in code else ""
        command = f"{end} {sys.executable} {tmp_path}/program.py || (({bool(end):d} && $? == 124))"
        run(["bash", "-c", command], tmp_path, domain)


@pytest.mark.parametrize(("code", "new"), blocks_with_news())
def test_commands(code: str, new: list[str], tmp_path: Path) -> None:
    if cannot_run(code):
        subprocess.run(["bash", "-n"], input=code, text=True, check=True, timeout=PATIENCE)
        return
    for line in {*lines(code)} - {*new}:
        words = LONG.sub("", line)
        if words.startswith("-"):
            parse_arguments(shlex.split(words))
    with ExitStack() as stack:
        domain = stack.enter_context(own_domain())
        script = "\n".join(("set -eo pipefail", *commands(new))).replace("/tmp/", f"{tmp_path}/")
        script = stack.enter_context(servos(script, robot_of(code)))
        run(["bash", "-c", script.replace("./scripts/run", "head_tracking")], tmp_path, domain)


@pytest.fixture(scope="module")
def known() -> set[str]:
    """The names of all parameters."""
    text = (ROOT / "docs/reference/parameters.md").read_text()
    return set(re.findall(r"^\| `(\S+)`", text, re.M))


def test_commands_set_parameters_that_nodes_know(known: set[str]) -> None:
    for block in blocks("bash"):
        for given in re.findall(r"-p (?:\w+:)?([\w.]+):=", str(block.values[0])):
            name = re.sub(r"^\w+_controller\.", "<controller>.", given)
            usual = re.sub(r"^(hand|face)\.", "visual_target.", name)  # a source of the mux
            assert usual in known


@pytest.mark.parametrize("code", blocks("yaml"))
def test_parameters_have_names_that_nodes_know(code: str, known: set[str]) -> None:
    def names(values: dict[str, object], prefix: str = "") -> Iterator[str]:
        for name, value in values.items():
            if isinstance(value, dict):
                yield from names(value, f"{prefix}{name}.")
            else:
                yield prefix + name

    for node in yaml.safe_load(code).values():
        for name in names(node["ros__parameters"]):
            assert re.sub(r"^\w+_controller\.", "<controller>.", name) in known


@pytest.mark.parametrize("code", blocks("xml"))
def test_xml_is_well_formed(code: str) -> None:
    ET.fromstring(f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro">{code}</robot>')


def test_every_block_has_a_language_that_is_tested() -> None:
    for path in DOCUMENTS:
        for match in BLOCK.finditer(path.read_text()):
            assert match[2] in ("python", "bash", "yaml", "xml", "text"), match[3]
