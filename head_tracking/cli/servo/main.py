"""servo: shows, configures and calibrates servos."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from head_tracking.cli.servo.calibrate import calibrate
from head_tracking.cli.servo.changes import relax, set_baud_rate, set_register
from head_tracking.cli.servo.overview import USUAL_BAUD_RATES, info, monitor, scan
from head_tracking.cli.servo.session import Session, Terminal
from head_tracking.command_line import (
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
    return exit_code("servo", lambda: options.run(opened, options))


def _common() -> argparse.ArgumentParser:
    """Return the options that are allowed before and after the command."""
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    add = common.add_argument
    add("--port", metavar="DEV", help=f"serial port ({_DEFAULT_PORT})")
    add("--baud", type=int, metavar="RATE", help=f"its baud rate ({_DEFAULT_BAUD_RATE})")
    add(
        "--model",
        type=read_by(servo_model, ConfigurationError),
        help="model of a servo that answers no reads",
    )
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

    def add_command(name: str, purpose: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=purpose, parents=[_common()])

    command = add_command("scan", "find servos over ids and baud rates")
    command.add_argument(
        "--bauds", type=int, nargs="+", metavar="RATE",
        help=f"baud rates to try (that of --baud, or {' '.join(map(str, USUAL_BAUD_RATES))})",
    )  # fmt: skip
    command.add_argument(
        "--ids", type=_ids, nargs="+", default=[range(254)], metavar="ID",
        help="ids to try, such as 1 2 10-20 (0-253)",
    )  # fmt: skip
    command.set_defaults(
        run=lambda s, o: scan(
            s,
            o.bauds or ([o.baud] if o.baud else USUAL_BAUD_RATES),
            sorted({i for ids in o.ids for i in ids}),
        )
    )

    command = add_command("info", "show all registers of a servo")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("--all", action="store_true", help="also the indirect registers")
    command.set_defaults(run=lambda s, o: info(s, o.id, o.model, all_of_them=o.all))

    command = add_command("set", "write a register")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("register", metavar="REGISTER", help="its name or its address")
    command.add_argument(
        "value", metavar="VALUE",
        help="counts, or a quantity such as 11.5V, -30deg, 2rad/s; `full` for full speed",
    )  # fmt: skip
    command.set_defaults(run=lambda s, o: set_register(s, o.id, o.register, o.value, o.model))

    command = add_command("set-id", "change the id of a servo")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("new_id", type=servo_id, metavar="NEW")
    command.set_defaults(run=lambda s, o: set_register(s, o.id, "ID", str(o.new_id), o.model))

    command = add_command("set-baud", "change the baud rate of a servo")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("rate", type=int, metavar="RATE")
    command.set_defaults(run=lambda s, o: set_baud_rate(s, o.id, o.rate, o.model))

    command = add_command("relax", "switch torque off")
    command.add_argument("ids", type=servo_id, nargs="*", metavar="ID", help="none: all servos")
    command.set_defaults(run=lambda s, o: relax(s, _once(o.ids), o.model))

    command = add_command("monitor", "show measured values until Ctrl-C")
    command.add_argument("ids", type=servo_id, nargs="*", metavar="ID", help="none: ids 0 to 29")
    command.add_argument(
        "--rate", type=between(0.1, 100.0, "Hz"), default=10.0, metavar="HZ", help="(%(default)s)"
    )
    command.add_argument(
        "--count", type=between(1, 1e9, "times", int), metavar="N", help="stop after N times"
    )
    command.set_defaults(
        run=lambda s, o: monitor(s, _once(o.ids), o.model, rate=o.rate, count=o.count)
    )

    command = add_command("calibrate", "measure zero, range and direction of joints moved by hand")
    command.add_argument(
        "servos", type=_named_servo, nargs="+", metavar="NAME:ID",
        help="name in the configuration and servo id, such as head_pan:1 head_tilt:2",
    )  # fmt: skip
    command.add_argument(
        "--output", type=writable_file, metavar="FILE", help="YAML to write (stdout)"
    )
    command.add_argument(
        "--margin", type=between(0.0, 1.0, "rad"), default=0.03, metavar="RAD",
        help="distance of the limits from both ends (%(default)s)",
    )  # fmt: skip
    command.set_defaults(
        run=lambda s, o: calibrate(s, o.servos, o.model, output=o.output, margin=o.margin)
    )
    return parser


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
