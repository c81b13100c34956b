"""head_setup: prints its steps and asks before it runs them."""

import configparser
import os
import sys
from pathlib import Path

import numpy
import pytest

from head_tracking.cli import head_setup
from head_tracking.cli.head_setup import Step, carry_out
from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import FAILED, REFUSED
from head_tracking.exceptions import HeadTrackingError
from head_tracking.share import share_directory

STEPS = [Step("first", ("one", "1")), Step("then", ("two",))]


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    prefix = tmp_path / "my workspace" / "install" / "head_tracking"
    (prefix / "share" / "head_tracking").mkdir(parents=True)
    (prefix / "share" / "head_tracking" / "package.xml").touch()
    (prefix.parent / "setup.bash").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/opt/ros/jazzy{os.pathsep}{prefix}")
    return prefix


def test_the_udev_rules_set_latency_and_group():
    install, *_ = head_setup.udev_steps()
    source, target = install.command[-2:]
    assert target == "/etc/udev/rules.d/99-dynamixel.rules"
    rules = Path(source).read_text()
    assert 'DRIVER=="ftdi_sio", ATTR{latency_timer}="1"' in rules
    assert 'GROUP="dialout"' in rules


def test_a_failed_step_ends_the_set_up():
    done = []

    def execute(command):
        done.append(command)
        return 1

    with pytest.raises(HeadTrackingError):
        carry_out(STEPS, Terminal(assume_yes=True), execute)
    assert done == [("one", "1")]


def test_the_unit_is_complete_with_the_arguments_of_the_head(workspace, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a b.yaml").touch()
    words = ["--port", "/dev/tty'1", "--params", "a b.yaml", "--mode", "point"]
    install, *_ = head_setup.service_steps(words, tmp_path)
    text = Path(install.command[-2]).read_text()
    unit = configparser.RawConfigParser(strict=False)
    unit.optionxform = str
    unit.read_string(text)
    start = unit["Service"]["ExecStart"]
    assert f'source "{workspace.parent}/setup.bash"' in start
    assert f'exec "{workspace}/lib/head_tracking/head_tracking" --keep-stop --port' in start
    assert "--params \\'a b.yaml\\' --mode point" in start
    assert unit["Service"]["WorkingDirectory"] == f"-{tmp_path}"
    assert unit["Service"]["KillSignal"] == "SIGINT"
    assert "@" not in text.partition("[Unit]")[2]


@pytest.mark.parametrize("words", ["--prot /dev/ttyUSB0", "--params nothing.yaml", "--yes"])
def test_a_service_that_would_fail_at_every_start_is_refused(workspace, words):
    with pytest.raises(SystemExit) as refused:
        head_setup.main(["service", *words.split()])
    assert refused.value.code == 2


def test_a_set_up_that_is_not_confirmed_leaves_no_file(workspace, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    before = set(tmp_path.iterdir())
    assert head_setup.main(["service"]) == REFUSED  # it cannot ask: no terminal
    assert set(tmp_path.iterdir()) == before


def test_libraries_of_the_requirements_are_installed_into_the_workspace(workspace, monkeypatch):
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    lists = (share_directory() / "requirements").glob("*.txt")
    lines = {line for path in lists for line in path.read_text().splitlines()}
    site = workspace / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
    for what in ("yourdfpy", "viewer", "faces"):
        (step,) = head_setup.library_steps(what)
        at = step.command.index("--target")
        assert step.command[at + 1] == str(site)
        words = step.command[at + 2 :]
        assert "--break-system-packages" not in words
        packages = {word for word in words if not word.startswith(("--", "opencv", "numpy"))}
        assert packages and packages <= lines
        keeps_numpy = "--no-deps" in words or f"numpy=={numpy.__version__}" in words
        assert keeps_numpy


def test_a_wrong_place_or_argument_is_refused(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/nowhere")
    assert head_setup.main(["service"]) == FAILED
    with pytest.raises(SystemExit):
        head_setup.main(["udev", "--port", "/dev/ttyUSB0"])
