"""relax: switches the torque of all servos off, once."""

from __future__ import annotations

import argparse
import sys
import time

from head_tracking.dynamixel import relax_servos
from head_tracking.ros.start import program

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
        "--servo", type=_servo, action="append", default=[], metavar="MODEL:ID",
        help="a servo on that port, such as XM430-W350:1; may be repeated",
    )  # fmt: skip
    add("--hold", action="store_true", help="hold them where they stand instead")
    options, _ = parser.parse_known_args()  # the others are ROS's
    if options.port is None:
        if options.servo or options.hold:
            parser.error("--servo and --hold need --port")
        return _ask_the_bus()
    if not options.servo:
        parser.error("--port needs the servos on it: --servo MODEL:ID")
    problems = relax_servos(options.port, dict(options.servo), options.baud, hold=options.hold)
    done = "holds, or was relaxed" if options.hold else "relaxed"
    for servo_id, problem in problems.items():
        print(f"servo {servo_id}: {problem or done}", file=sys.stderr if problem else sys.stdout)
    return 1 if any(problems.values()) else 0


def _servo(text: str) -> tuple[int, str]:
    model, _, number = text.rpartition(":")
    if not model or not number.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no MODEL:ID, such as XM430-W350:1")
    return int(number), model


def _ask_the_bus() -> int:
    """Call the service `relax` of the servo bus."""
    import rclpy
    from std_srvs.srv import Trigger

    from head_tracking.ros.start import start_ros
    from head_tracking.ros.stop_signal import StopSignal

    with StopSignal() as stop:
        start_ros()
        node = rclpy.create_node("relax")
        try:
            client = node.create_client(Trigger, "relax")
            deadline = time.monotonic() + _PATIENCE
            while not client.service_is_ready():
                if stop() or time.monotonic() > deadline:
                    print(
                        "no servo_bus answers: is one running in this domain? Without one: "
                        "relax --port NAME --servo MODEL:ID",
                        file=sys.stderr,
                    )
                    return 1
                time.sleep(0.02)
            answer = client.call_async(Trigger.Request())
            rclpy.spin_until_future_complete(node, answer, timeout_sec=_PATIENCE)
            if not answer.done():
                print("the servo bus did not answer", file=sys.stderr)
                return 1
            print(answer.result().message)
            return 0 if answer.result().success else 1
        finally:
            node.destroy_node()
            rclpy.try_shutdown()


if __name__ == "__main__":
    raise SystemExit(main())
