"""simulated_bus: AX-12 servos behind a port that any Dynamixel program can open."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Sequence

from head_tracking.simulation import SimulatedPort, SimulatedServo, SimulationError


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the port to open and serves it until SIGINT or SIGTERM; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="simulated_bus",
        description="Simulates AX-12 servos on a serial port; prints the port to open.",
    )
    parser.add_argument(
        "--ids", type=_servo_id, nargs="+", default=[1, 2], metavar="ID",
        help="the servos' ids (default: 1 2)",
    )  # fmt: skip
    parser.add_argument("--link", metavar="PATH", help="also make a link to the port here")
    options = parser.parse_args(arguments)
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    try:
        with SimulatedPort((SimulatedServo(i) for i in options.ids), link=options.link) as port:
            print(port.port_name, flush=True)
            ids = ", ".join(map(str, options.ids))
            print(f"AX-12 servos with ids {ids} at any baud rate; Ctrl-C ends it", file=sys.stderr)
            stopped.wait()
    except SimulationError as error:
        print(f"simulated_bus: {error}", file=sys.stderr)
        return 1
    return 0


def _servo_id(text: str) -> int:
    if not text.isdigit() or int(text) > 253:
        raise argparse.ArgumentTypeError(f"{text!r} is no servo id; ids are 0 to 253")
    return int(text)


if __name__ == "__main__":
    raise SystemExit(main())
