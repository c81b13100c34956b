"""doctor: checks the port, the adapter, the servos, the configuration and the clocks of a head."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NoReturn

from head_tracking.cli.doctor.configured import (
    check_calibration,
    check_configured,
    check_model,
)
from head_tracking.cli.doctor.findings import Finding, Grade, show
from head_tracking.cli.doctor.servos import check_bus
from head_tracking.cli.servo.session import patient_port
from head_tracking.command_line import INTERRUPTED, baud_rate, between, without_ros_arguments
from head_tracking.dynamixel import DynamixelPort
from head_tracking.programs import NO_ROS
from head_tracking.share import NotInstalledError, robot_parameters

_WRONG_COMMAND_LINE: Final = 3

_EPILOG = """\
It moves nothing and writes to no servo. It does not use a port that another program has open.
exit codes (of monitoring plugins): 0 all green; 1 something is amber; 2 something is red; 3 wrong
command line. ROS arguments follow --ros-args.
"""

MakePort = Callable[[str, int], DynamixelPort]


class _Parser(argparse.ArgumentParser):
    """Exits with 3 after a wrong command line; 2 means that something is red."""

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        self.exit(_WRONG_COMMAND_LINE, f"{self.prog}: {message}\n")


def main(arguments: Sequence[str] | None = None, make_port: MakePort = patient_port) -> int:
    """Check everything and return the exit code; `make_port` makes a closed port."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser().parse_args(without_ros_arguments(words))
    worst = Grade.GREEN
    try:
        for finding in _check(options, words, make_port):
            show(finding)
            worst = max(worst, finding.level)
    except KeyboardInterrupt:
        return INTERRUPTED
    print(f"\n{'all is' if worst is Grade.GREEN else 'something is'} {worst.name.lower()}")
    return worst


def _check(
    options: argparse.Namespace, ros: Sequence[str], make_port: MakePort
) -> Iterator[Finding]:
    try:
        yield from _check_head(options, make_port)
    except NotInstalledError as error:
        yield Finding("configuration", Grade.RED, str(error))
    if options.listen == 0.0:
        yield Finding("network", Grade.SKIPPED, "not checked with --listen 0")
        return
    try:
        from head_tracking.cli.doctor.network import check_network
    except ImportError as error:
        yield Finding("network", Grade.AMBER, f"nodes cannot run: {error}. {NO_ROS}")
    else:
        yield from check_network(ros, options.listen)


def _check_head(options: argparse.Namespace, make_port: MakePort) -> Iterator[Finding]:
    files = [*robot_parameters(options.robot), *options.params]
    finding, buses = check_configured(files, options.port, options.baud)
    yield finding
    if buses:
        yield check_model(options.robot, files, buses)
    if options.calibration:
        yield check_calibration(options.robot, options.calibration, files)
    for each in buses if not options.sim else ():
        yield from check_bus(each, make_port)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="doctor",
        description="Checks the requirements of a head, and reports problems.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--sim", action="store_true", help="skip the checks of the servos")
    add("--port", default="", metavar="DEV", help="serial port (as configured, or /dev/ttyUSB0)")
    add("--baud", type=baud_rate, default=0, metavar="RATE", help="its baud rate (as configured)")
    add(
        "--robot", default="kinectbot", metavar="NAME|FILE",
        help="name of the robot, or a URDF or xacro file (%(default)s)",
    )  # fmt: skip
    add(
        "--params", action="append", type=Path, default=[], metavar="FILE",
        help="YAML file with parameters that override the robot's; can be given several times",
    )  # fmt: skip
    add("--calibration", type=Path, metavar="FILE", help="calibration of the head: checks its age")
    add(
        "--listen", type=between(0.0, 3600.0, "s"), default=3.0, metavar="S",
        help="time for the checks of other nodes; 0: skip them (%(default)s s)",
    )  # fmt: skip
    return parser
