"""relax: switches the torque of all servos off, once."""

from __future__ import annotations

import argparse
import sys

from head_tracking.command_line import named_id
from head_tracking.dynamixel import relax_servos
from head_tracking.ros.start import program
from head_tracking.tools.client import running_client

_PATIENCE = 10.0  # s; discovery of a running servo_bus can take a few


@program("relax")
def main() -> int:
    """Relax the servos and return 0 if every one has confirmed.

    Without --port a running servo_bus does it; with --port no other program may use that port.
    """
    parser = argparse.ArgumentParser(prog="relax", description="Switch the torque of servos off.")
    add = parser.add_argument
    add("--port", help="serial port of servos that no running program drives")
    add("--baud", type=int, default=1_000_000, metavar="RATE", help="its speed (1000000)")
    add(
        "--servo", type=named_id, action="append", default=[], metavar="MODEL:ID",
        help="a servo on that port, such as XM430-W350:1; may be repeated",
    )  # fmt: skip
    add("--hold", action="store_true", help="hold them where they stand instead")
    options, _ = parser.parse_known_args()  # the others are ROS's
    if options.port is None:
        if options.servo or options.hold:
            parser.error("--servo and --hold need --port")
        with running_client("relax") as client:
            print(client.call(["relax"], _PATIENCE))
        return 0
    if not options.servo:
        parser.error("--port needs the servos on it: --servo MODEL:ID")
    models = {servo_id: model for model, servo_id in options.servo}
    problems = relax_servos(options.port, models, options.baud, hold=options.hold)
    done = "holds, or was relaxed" if options.hold else "relaxed"
    for servo_id, problem in problems.items():
        print(f"servo {servo_id}: {problem or done}", file=sys.stderr if problem else sys.stdout)
    return 1 if any(problems.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
