"""The program servo_bus, with simulated servos if wanted, as a child that ends with its parent.

Started by `head_tracking.nodes.bus_process`, with the descriptor of its end of a connection, and a
dictionary in JSON: "simulated", and the node's "parameters". None on the connection is answered by
a `Report`, "stop" and "resume" by what the node's methods return; its end, which also a killed
parent brings about, ends the program.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from head_tracking.exceptions import HeadTrackingError
from head_tracking.output import output_may_get_lost
from head_tracking.ros.stop_signal import ENDING, StopSignal

if TYPE_CHECKING:
    from head_tracking.dynamixel import JointConfiguration
    from head_tracking.nodes.bus_process import Report
    from head_tracking.nodes.servo_bus import ServoBusNode


def main() -> int:
    """Runs the bus until a signal, or until the parent has gone; returns the exit code."""
    descriptor, wanted = int(sys.argv[1]), json.loads(sys.argv[2])
    with output_may_get_lost(), StopSignal() as stop:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)  # held back by the parent until now
        return _Program(wanted["simulated"], wanted["parameters"]).run(Connection(descriptor), stop)


class _Program:
    def __init__(self, simulated: bool, parameters: dict[str, Any]) -> None:
        self._simulated, self._parameters = simulated, parameters
        self._report: Callable[[], Report] | None = None
        self._newest: Report | None = None
        self._node: ServoBusNode | None = None

    def run(self, parent: Connection[Any, Any], stop: StopSignal) -> int:
        threading.Thread(target=self._answer, args=(parent, stop), daemon=True).start()
        with stop.while_importing():
            from head_tracking.nodes import servo_bus  # noqa: F401
            from head_tracking.ros.spinning import run_until

        with ExitStack() as resources:
            return run_until(stop, lambda: self._make(resources), sys.argv)

    def _answer(self, parent: Connection[Any, Any], stop: StopSignal) -> None:
        with suppress(EOFError, OSError):
            while True:
                number, wanted = parent.recv()
                if wanted is not None:
                    answer = None
                    with suppress(HeadTrackingError):  # stopped by somebody else meanwhile
                        answer = None if self._node is None else getattr(self._node, wanted)()
                    parent.send((number, answer))
                    continue
                if self._report is not None:
                    report = self._report()
                    if not stop():  # a bus that is being closed looks like one that is unplugged
                        self._newest = report
                parent.send((number, self._newest))
        stop.set()

    def _make(self, resources: ExitStack) -> ServoBusNode:
        from rclpy.parameter import Parameter

        from head_tracking.nodes.bus_process import Report
        from head_tracking.nodes.servo_bus import ServoBusNode
        from head_tracking.simulation import SimulatedJoints

        simulated: dict[str, SimulatedJoints] = {}

        def simulate(joints: Sequence[JointConfiguration]) -> str:
            servos = resources.enter_context(SimulatedJoints(joints))
            simulated.update((joint.joint_name, servos) for joint in joints)
            return servos.port_name

        node = ServoBusNode(
            simulate if self._simulated else None,
            parameter_overrides=[
                Parameter(name, value=value) for name, value in self._parameters.items()
            ],
        )

        def report() -> Report:
            return Report(
                node.status(),
                {joint: servos.true_position(joint) for joint, servos in simulated.items()},
            )

        self._newest, self._report, self._node = report(), report, node
        return node


if __name__ == "__main__":
    raise SystemExit(main())
