"""servo: shows what servos measure, sets them up, and calibrates a head."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from head_tracking.cli.servo.bench import Terminal, Workshop
from head_tracking.cli.servo.calibrate import Wanted, calibrate
from head_tracking.cli.servo.changes import relax, set_baud_rate, set_register
from head_tracking.cli.servo.overview import USUAL_BAUD_RATES, info, monitor, scan
from head_tracking.command_line import (
    between,
    exit_code,
    named_id,
    read_by,
    servo_id,
    with_numbers,
    writable_file,
)
from head_tracking.dynamixel.exceptions import ConfigurationError
from head_tracking.dynamixel.models import servo_model

_DEFAULT_PORT, _DEFAULT_BAUD_RATE = "/dev/ttyUSB0", 1_000_000

_EPILOG = """\
exit codes: 0 done; 1 failed (no port, no answer, no such register); 2 wrong command line;
3 refused, because it could do harm or was not confirmed; 130 stopped by Ctrl-C
"""


def main(
    arguments: Sequence[str] | None = None, workshop: Callable[..., Workshop] = Workshop
) -> int:
    """Carry out a command; return the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(with_numbers(words))
    terminal = Terminal(assume_yes=options.yes)
    bench = workshop(terminal, options.port, options.baud or _DEFAULT_BAUD_RATE)
    return exit_code("servo", lambda: options.run(bench, options))


def _common() -> argparse.ArgumentParser:
    """Return the options that are allowed before the command and after it."""
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
        description="Shows what servos measure, sets them up, and calibrates a head.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        parents=[_common()],
    )
    parser.set_defaults(port=_DEFAULT_PORT, baud=None, model=None, yes=False)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def add_command(name: str, purpose: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=purpose, parents=[_common()])

    command = add_command("scan", "look for servos over ids and baud rates")
    command.add_argument(
        "--bauds", type=int, nargs="+", metavar="RATE",
        help=f"baud rates to try (that of --baud, or {' '.join(map(str, USUAL_BAUD_RATES))})",
    )  # fmt: skip
    command.add_argument(
        "--ids", type=_ids, nargs="+", default=[range(254)], metavar="ID",
        help="ids to try, such as 1 2 10-20 (0-253)",
    )  # fmt: skip
    command.set_defaults(
        run=lambda w, o: scan(
            w,
            o.bauds or ([o.baud] if o.baud else USUAL_BAUD_RATES),
            sorted({i for ids in o.ids for i in ids}),
        )
    )

    command = add_command("info", "show all registers of a servo")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("--all", action="store_true", help="also the indirect registers")
    command.set_defaults(run=lambda w, o: info(w, o.id, o.model, all_of_them=o.all))

    command = add_command("set", "write a register")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("register", metavar="REGISTER", help="its name or its address")
    command.add_argument(
        "value", metavar="VALUE",
        help="counts, or a quantity such as 11.5V, -30deg, 2rad/s; `full` for full speed",
    )  # fmt: skip
    command.set_defaults(run=lambda w, o: set_register(w, o.id, o.register, o.value, o.model))

    command = add_command("set-id", "give a servo another id")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("new_id", type=servo_id, metavar="NEW")
    command.set_defaults(run=lambda w, o: set_register(w, o.id, "ID", str(o.new_id), o.model))

    command = add_command("set-baud", "give a servo another baud rate")
    command.add_argument("id", type=servo_id, metavar="ID")
    command.add_argument("rate", type=int, metavar="RATE")
    command.set_defaults(run=lambda w, o: set_baud_rate(w, o.id, o.rate, o.model))

    command = add_command("relax", "switch torque off")
    command.add_argument("ids", type=servo_id, nargs="*", metavar="ID", help="none: all servos")
    command.set_defaults(run=lambda w, o: relax(w, _once(o.ids), o.model))

    command = add_command("monitor", "show what servos measure, until Ctrl-C")
    command.add_argument("ids", type=servo_id, nargs="*", metavar="ID", help="none: ids 0 to 29")
    command.add_argument(
        "--rate", type=between(0.1, 100.0, "Hz"), default=10.0, metavar="HZ", help="(%(default)s)"
    )
    command.add_argument(
        "--count", type=between(1, 1e9, "times", int), metavar="N", help="stop after N times"
    )
    command.set_defaults(
        run=lambda w, o: monitor(w, _once(o.ids), o.model, rate=o.rate, count=o.count)
    )

    command = add_command("calibrate", "find zero, range and sign of joints by moving them by hand")
    command.add_argument(
        "servos", type=_wanted, nargs="+", metavar="NAME:ID",
        help="name in the configuration and servo id, such as head_pan:1 head_tilt:2",
    )  # fmt: skip
    command.add_argument(
        "--output", type=writable_file, metavar="FILE", help="YAML to write (stdout)"
    )
    command.add_argument(
        "--margin", type=between(0.0, 1.0, "rad"), default=0.03, metavar="RAD",
        help="how far to stay away from both ends (%(default)s)",
    )  # fmt: skip
    command.set_defaults(
        run=lambda w, o: calibrate(w, o.servos, o.model, output=o.output, margin=o.margin)
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


def _wanted(text: str) -> Wanted:
    name, number = named_id(text)
    if not name.isidentifier():
        raise argparse.ArgumentTypeError(f"{name!r} is not a name, such as head_pan")
    return Wanted(name, number)
