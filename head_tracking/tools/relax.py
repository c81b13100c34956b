"""relax: switches the torque of all servos off, once."""

from __future__ import annotations

import sys
import time

import rclpy
from std_srvs.srv import Trigger

from head_tracking.ros.start import program, start_ros
from head_tracking.ros.stop_signal import StopSignal

_PATIENCE = 10.0  # s; discovery of a running servo_bus can take a few


@program("relax")
def main() -> int:
    """Calls the service `relax` of the servo bus; 0 if every servo confirmed."""
    with StopSignal() as stop:
        start_ros()
        node = rclpy.create_node("relax")
        try:
            client = node.create_client(Trigger, "relax")
            deadline = time.monotonic() + _PATIENCE
            while not client.service_is_ready():
                if stop() or time.monotonic() > deadline:
                    print("no servo_bus answers: is one running in this domain?", file=sys.stderr)
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
