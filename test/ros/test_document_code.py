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
from contextlib import ExitStack
from pathlib import Path
from textwrap import dedent

import pytest
from program_names import NODES
from rig import PYTHONPATH, own_domain

from head_tracking.configuration import configured_head
from head_tracking.configuration.simulated import mounted_servos
from head_tracking.parameter_files import read
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


def run(script: str, folder: Path, code: str) -> None:
    """Run a script in a folder, with servos of the robot of a block if it names their port."""
    (folder / "urdf").symlink_to(ROOT / "urdf")
    for name in ("head_tracking", "ros2"):
        program = folder / name
        program.write_text(
            f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {STAND_IN} {name} "$@"\n'
        )
        program.chmod(0o755)
    with ExitStack() as stack:
        environment = os.environ | {
            "PATH": f"{folder}:{os.environ['PATH']}",
            "PYTHONPATH": PYTHONPATH,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": stack.enter_context(own_domain()),
            "HOME": str(folder),
        }
        if PORT in code:
            named = re.search(r'robot[= ]"?([a-z]\w+)', code)
            robot = configured_head(robot_parameters(named[1] if named else "kinectbot"))
            port = stack.enter_context(SimulatedPort(mounted_servos(robot.servos), paced=True))
            environment["PORT"] = port.port_name
        answer = subprocess.run(
            ["env", "--default-signal", "bash", "-c", script],
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


@pytest.mark.parametrize("code", blocks("python"))
def test_python(code, tmp_path):
    if cannot_run(code):
        ast.parse(code)
        return
    program = tmp_path / "program.py"
    program.write_text(f"import os\n{code}".replace(f'"{PORT}"', 'os.environ["PORT"]'))
    end = "timeout --signal TERM --kill-after 20 4" if "rclpy.spin" in code else ""
    run(f"{end} {sys.executable} {program} || (({bool(end):d} && $? == 124))", tmp_path, code)


@pytest.mark.parametrize(("code", "new"), blocks_with_news())
def test_commands(code, new, tmp_path):
    """What begins in the background ends with the block."""
    if cannot_run(code):
        subprocess.run(["bash", "-n"], input=code, text=True, check=True, timeout=PATIENCE)
        return
    for line in {*lines(code)} - {*new}:
        words = LONG.sub("", line)
        if words.startswith("-"):
            parse_arguments(shlex.split(words))
    # beside other work simulated servos may answer late, and doctor counts that
    tried = (f"until {line}; do sleep 1; done" if " doctor " in line else line for line in new)
    end = "trap 'kill $(jobs -p) 2>/dev/null || true; wait || true' EXIT"
    script = "\n".join(("set -eo pipefail", end, *tried)).replace("/tmp/", f"{tmp_path}/")
    script = script.replace("./scripts/run", "head_tracking").replace(PORT, '"$PORT"')
    script = re.sub(r"(--duration) \d+$", r"\1 1", script, flags=re.MULTILINE)  # s
    run(script, tmp_path, code)


def test_parameters_have_names_that_nodes_know(tmp_path):
    text = (ROOT / "docs/reference/parameters.md").read_text()
    known = set(re.findall(r"^\| `(\S+)`", text, re.M))
    file = tmp_path / "parameters.yaml"
    for block in blocks("yaml"):
        file.write_text(block.values[0])
        names = (re.sub(r"^\w+_controller", "<controller>", each.name) for each in read(str(file)))
        assert known.issuperset(names)
    for block in blocks("bash"):
        for given in re.findall(r"-p (?:\w+:)?([\w.]+):=", str(block.values[0])):
            name = re.sub(r"^\w+_controller", "<controller>", given)
            assert re.sub(r"^(hand|face)\.", "visual_target.", name) in known  # a source of the mux


@pytest.mark.parametrize("code", blocks("xml"))
def test_xml_is_well_formed(code):
    ET.fromstring(f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro">{code}</robot>')


def test_every_block_has_a_language_that_is_tested():
    for path in DOCUMENTS:
        for match in BLOCK.finditer(path.read_text()):
            assert match[2] in ("python", "bash", "yaml", "xml", "text"), match[3]
