"""servo: shows, configures and calibrates servos."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace

from head_tracking.cli.servo.changes import relax, set_register
from head_tracking.cli.servo.joint_calibration import calibrate
from head_tracking.cli.servo.overview import info, monitor, scan
from head_tracking.cli.servo.session import USUAL_BAUD_RATES, Session
from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import (
    baud_rate,
    between,
    exit_code,
    named_id,
    read_by,
    servo_id,
    with_negative_values,
    writable_file,
)
from head_tracking.dynamixel.exceptions import ConfigurationError
from head_tracking.dynamixel.models import servo_model

_DEFAULT_PORT, _DEFAULT_BAUD_RATE = "/dev/ttyUSB0", 1_000_000

_EPILOG = """\
exit codes: 0 done; 1 failed (no port, no answer, no such register); 2 wrong command line;
3 refused or not confirmed; 130 Ctrl-C
"""


def main(arguments: Sequence[str] | None = None, session: Callable[..., Session] = Session) -> int:
    """Run a command; return the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(with_negative_values(words))
    terminal = Terminal(assume_yes=options.yes)
    opened = session(terminal, options.port, options.baud or _DEFAULT_BAUD_RATE)
    opened = replace(opened, model=options.model)
    return exit_code("servo", lambda: options.run(opened, options))


def _common() -> argparse.ArgumentParser:
    """Return the options that are allowed before and after the command."""
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    add = common.add_argument
    add("--port", metavar="DEV", help=f"serial port ({_DEFAULT_PORT})")
    add("--baud", type=baud_rate, metavar="RATE", help=f"its baud rate ({_DEFAULT_BAUD_RATE})")
    known = read_by(servo_model, ConfigurationError)
    add("--model", type=known, help="model of a servo that answers no reads")
    add("--yes", action="store_true", help="answer every question with yes")
    return common


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="servo",
        description="Shows, configures and calibrates servos.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        parents=[_common()],
    )
    parser.set_defaults(port=_DEFAULT_PORT, baud=None, model=None, yes=False)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def add_command(
        name: str, purpose: str, run: Callable[[Session, argparse.Namespace], None], *ids: str
    ) -> Callable[..., argparse.Action]:
        command = commands.add_parser(name, help=purpose, parents=[_common()])
        command.set_defaults(run=run)
        for metavar in ids:
            command.add_argument(metavar.lower(), type=servo_id, metavar=metavar)
        return command.add_argument

    add = add_command("scan", "find servos over ids and baud rates", _scan)
    add(
        "--bauds", type=baud_rate, nargs="+", metavar="RATE",
        help=f"baud rates to try (that of --baud, or {' '.join(map(str, USUAL_BAUD_RATES))})",
    )  # fmt: skip
    add(
        "--ids", type=_ids, nargs="+", default=[range(254)], metavar="ID",
        help="ids to try, such as 1 2 10-20 (0-253)",
    )  # fmt: skip
    add = add_command(
        "info", "show all registers of a servo",
        lambda s, o: info(s, o.id, all_of_them=o.all), "ID",
    )  # fmt: skip
    add("--all", action="store_true", help="also the indirect registers")
    add = add_command(
        "set", "write a register", lambda s, o: set_register(s, o.id, o.register, o.value), "ID"
    )
    add("register", metavar="REGISTER", help="its name or its address")
    add(
        "value", metavar="VALUE",
        help="counts, or a quantity such as 11.5V, -30deg, 2rad/s; `full` for full speed",
    )  # fmt: skip
    add_command(
        "set-id", "change the id of a servo",
        lambda s, o: set_register(s, o.id, "ID", str(o.new)), "ID", "NEW",
    )  # fmt: skip
    add = add_command(
        "set-baud", "change the baud rate of a servo",
        lambda s, o: set_register(s, o.id, "Baud Rate", f"{o.rate} baud"), "ID",
    )  # fmt: skip
    add("rate", type=int, metavar="RATE")
    add = add_command("relax", "switch torque off", lambda s, o: relax(s, _once(o.ids)))
    add("ids", type=servo_id, nargs="*", metavar="ID", help="none: all servos")
    add = add_command(
        "monitor", "show measured values until Ctrl-C",
        lambda s, o: monitor(s, _once(o.ids), rate=o.rate, count=o.count),
    )  # fmt: skip
    add("ids", type=servo_id, nargs="*", metavar="ID", help="none: ids 0 to 29")
    add("--rate", type=between(0.1, 100, "Hz"), default=10.0, metavar="HZ", help="(%(default)s)")
    add(
        "--count", type=between(1, 1e9, "times", int), default=0, metavar="N",
        help="stop after N times",
    )  # fmt: skip
    add = add_command(
        "calibrate", "measure zero, range and direction of joints moved by hand",
        lambda s, o: calibrate(s, o.servos, output=o.output, margin=o.margin),
    )  # fmt: skip
    add(
        "servos", type=_named_servo, nargs="+", metavar="NAME:ID",
        help="name in the configuration and servo id, such as head_pan:1 head_tilt:2",
    )  # fmt: skip
    add("--output", type=writable_file, metavar="FILE", help="YAML to write (stdout)")
    add(
        "--margin", type=between(0.0, 1.0, "rad"), default=0.03, metavar="RAD",
        help="distance of the limits from both ends (%(default)s)",
    )  # fmt: skip
    return parser


def _scan(session: Session, options: argparse.Namespace) -> None:
    rates = options.bauds or ([options.baud] if options.baud else USUAL_BAUD_RATES)
    scan(session, rates, sorted({number for ids in options.ids for number in ids}))


def _once(ids: Sequence[int]) -> list[int]:
    return list(dict.fromkeys(ids))


def _ids(text: str) -> range:
    first, dash, last = text.partition("-")
    ids = range(servo_id(first), servo_id(last if dash else first) + 1)
    if not ids:
        raise argparse.ArgumentTypeError(f"{text!r} is not a range of ids, such as 10-20")
    return ids


def _named_servo(text: str) -> tuple[str, int]:
    name, number = named_id(text)
    if not name.isidentifier():
        raise argparse.ArgumentTypeError(f"{name!r} is not a name, such as head_pan")
    return name, number
