"""doctor: looks at everything that a head needs, and says what to do about what is wrong."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from head_tracking.tools.doctor.findings import Finding, Level, exit_code, tell
from head_tracking.tools.doctor.machine import Machine, look_at_machine, look_at_security

if TYPE_CHECKING:
    from head_tracking.tools.doctor.network import Heard

_UNKNOWN = 3

_EPILOG = """\
Moves nothing, writes to no servo, and leaves a port alone that another program owns.
exit codes, as monitoring plugins have them: 0 all green; 1 something is amber; 2 something is red;
3 nothing was looked at (wrong command line). ROS's own arguments follow --ros-args.
"""


@dataclass(frozen=True, slots=True)
class Looks:
    """What is looked at; tests put something else in its place.

    Attributes:
        machine: This machine.
        bus: Options for `look_at_bus`.
        listen: Listens to nodes, with ROS's arguments, for so many seconds; None: `listen`.
    """

    machine: Machine = field(default_factory=Machine)
    bus: dict[str, Any] = field(default_factory=dict)
    listen: Any = None


class _Parser(argparse.ArgumentParser):
    """2 says that something is red, not that the command line is wrong."""

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        self.exit(_UNKNOWN, f"{self.prog}: {message}\n")


def main(arguments: Sequence[str] | None = None, looks: Looks | None = None) -> int:
    """Looks at everything; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    ros = words.index("--ros-args") if "--ros-args" in words else len(words)
    options = _parser().parse_args(words[:ros])
    findings = []
    try:
        for finding in _look(options, words[ros:], looks or Looks()):
            findings.append(finding)
            tell(finding, sys.stdout)
            sys.stdout.flush()
    except KeyboardInterrupt:
        return 130
    code = exit_code(findings)
    print(f"\n{('all is green', 'something is amber', 'something is red')[code]}")
    return code


def _look(options: argparse.Namespace, ros: Sequence[str], looks: Looks) -> Iterator[Finding]:
    machine = looks.machine
    yield from look_at_machine(machine)
    if not machine.has_libraries:
        yield Finding("model and servos", Level.SKIPPED, "not looked at without the libraries")
    else:
        yield from _look_at_head(options, looks)
    if not machine.has_ros or options.listen <= 0.0:
        yield look_at_security(machine, None)
        why = "with --listen 0" if machine.has_ros else "without ROS"
        yield Finding("network", Level.SKIPPED, f"not looked at {why}")
    else:
        from head_tracking.ros.start import in_short
        from head_tracking.tools.doctor.network import listen, look_at_network

        try:
            heard: Heard = (looks.listen or listen)(ros, options.listen)
        except RuntimeError as error:  # rclpy's
            security = look_at_security(machine, in_short(error))
            yield security
            if security.level is Level.RED:
                yield Finding("network", Level.SKIPPED, "not looked at without a node")
                return
            cure = "look at what is set: env | grep -E 'ROS|RMW|DDS'; docs/distributed.md"
            yield Finding("network", Level.RED, in_short(error), cure)
            return
        yield look_at_security(machine, "")
        yield from look_at_network(heard)


def _look_at_head(options: argparse.Namespace, looks: Looks) -> Iterator[Finding]:
    from head_tracking.share import share_directory
    from head_tracking.tools.doctor.configuration import look_at_configuration, look_at_model

    try:
        config = share_directory() / "config"
    except FileNotFoundError as error:
        yield Finding("configuration", Level.RED, str(error), "install the package again")
        return
    own = config / f"{options.robot}.yaml"
    files = [config / "head.yaml", *([own] if own.is_file() else []), *options.params]
    finding, buses = look_at_configuration(files, options.port, options.baud)
    yield finding
    if buses:
        yield look_at_model(options.robot, files, buses)
    if options.sim:
        yield Finding("servos", Level.SKIPPED, "not looked at with --sim")
        return
    from head_tracking.tools.doctor.servos import look_at_bus

    for bus in buses:
        yield from look_at_bus(bus, **looks.bus)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="doctor",
        description="Looks at everything that a head needs, and says what to do about the rest.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--sim", action="store_true", help="there is no hardware: leave the servos out")
    add("--port", default="", metavar="DEV", help="serial port (as configured, or /dev/ttyUSB0)")
    add("--baud", type=int, default=0, metavar="RATE", help="its baud rate (as configured)")
    add(
        "--robot", default="kinectbot", metavar="NAME|FILE",
        help="kinectbot, turtlebot, or a URDF or xacro file (%(default)s)",
    )  # fmt: skip
    add(
        "--params", action="append", type=Path, default=[], metavar="FILE",
        help="parameters in YAML, over the robot's own; can be given several times",
    )  # fmt: skip
    add(
        "--listen", type=float, default=3.0, metavar="S",
        help="how long to listen to other nodes; 0: not at all (%(default)s s)",
    )  # fmt: skip
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
