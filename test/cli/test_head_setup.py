"""head_setup: prints its steps and asks before it runs them."""

from __future__ import annotations

import configparser
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy
import pytest

from head_tracking.cli import head_setup
from head_tracking.cli.head_setup import DONE, FAILED, REFUSED, Step, carry_out
from head_tracking.share import share_directory

STEPS = [Step("first", ("one", "1")), Step("then", ("two",))]


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    prefix = tmp_path / "my workspace" / "install" / "head_tracking"
    (prefix / "share" / "head_tracking").mkdir(parents=True)
    (prefix / "share" / "head_tracking" / "package.xml").touch()
    (prefix.parent / "setup.bash").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/opt/ros/jazzy{os.pathsep}{prefix}")
    return prefix


def test_nothing_is_done_without_confirmation(
    capsys: pytest.CaptureFixture[str],
) -> None:
    done: list[Sequence[str]] = []
    for dry_run, code in ((True, DONE), (False, REFUSED)):
        assert carry_out(STEPS, dry_run=dry_run, yes=False, execute=done.append) == code
        assert "first:\n    one 1\nthen:\n    two\n" in capsys.readouterr().out
    assert not done


def test_a_failed_step_ends_the_set_up(capsys: pytest.CaptureFixture[str]) -> None:
    done: list[Sequence[str]] = []

    def execute(command: Sequence[str]) -> int:
        done.append(command)
        return 1

    assert carry_out(STEPS, dry_run=False, yes=True, execute=execute) == FAILED
    assert done == [("one", "1")]
    assert "failed: one 1" in capsys.readouterr().err


def test_a_missing_command_is_a_failure(capsys: pytest.CaptureFixture[str]) -> None:
    steps = [Step("x", ("no-such-program-anywhere",))]
    assert carry_out(steps, dry_run=False, yes=True) == FAILED
    assert "no-such-program" in capsys.readouterr().err


def test_the_udev_rules_set_latency_and_group() -> None:
    install, *_ = head_setup.udev_steps(share_directory())
    source, target = install.command[-2:]
    assert target == "/etc/udev/rules.d/99-dynamixel.rules"
    rules = Path(source).read_text()
    assert 'DRIVER=="ftdi_sio", ATTR{latency_timer}="1"' in rules
    assert 'GROUP="dialout"' in rules


def test_the_unit_is_complete(workspace: Path) -> None:
    install, *_ = head_setup.service_steps(share_directory(), ["--port", "/dev/tty'1"])
    text = Path(install.command[-2]).read_text()
    unit = configparser.RawConfigParser(strict=False)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read_string(text)
    start = unit["Service"]["ExecStart"]
    assert f'source "{workspace.parent}/setup.bash"' in start
    assert f'exec "{workspace}/lib/head_tracking/head_tracking" --keep-stop --port' in start
    assert unit["Service"]["KillSignal"] == "SIGINT"
    assert "@" not in text.partition("[Unit]")[2]


def test_libraries_are_installed_into_the_workspace(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    (step,) = head_setup.library_steps("yourdfpy")
    target = workspace / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}"
    assert step.command[step.command.index("--target") + 1] == str(target / "site-packages")
    assert "--break-system-packages" not in step.command


def test_the_page_keeps_the_numpy_of_ros(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    (step,) = head_setup.library_steps("viewer")
    assert f"numpy=={numpy.__version__}" in step.command


def test_the_libraries_are_those_of_the_requirements() -> None:
    lists = share_directory() / "requirements"
    lines = [
        line
        for name in ("libraries", "yourdfpy", "viewer", "vision")
        for line in (lists / f"{name}.txt").read_text().splitlines()
    ]
    for _, words in head_setup._LIBRARIES.values():
        packages = [word for word in words if not word.startswith(("--", "opencv"))]
        assert set(packages) <= set(lines)


def test_arguments_after_service_are_those_of_the_head(
    workspace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--port", "/dev/ttyUSB0", "--sim", "--params", "a b.yaml"]
    assert head_setup.main(["--dry-run", "service", *words]) == DONE
    words_printed = capsys.readouterr().out.split()
    unit = Path(words_printed[words_printed.index("0644") + 1]).read_text()
    assert "--port /dev/ttyUSB0 --sim --params \\'a b.yaml\\'" in unit
    with pytest.raises(SystemExit):
        head_setup.main(["udev", "--port", "/dev/ttyUSB0"])
    assert "unrecognized arguments: --port /dev/ttyUSB0" in capsys.readouterr().err


def test_a_service_needs_a_workspace(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/nowhere")
    assert head_setup.main(["service"]) == FAILED
    assert "colcon build" in capsys.readouterr().err
