"""The control process: servo bus, head and their ROS interface in one loop."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent import futures
from dataclasses import asdict
from functools import partial
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from head_tracking.configuration.simulated import SimulatedJoints
from head_tracking.control import ControlLoop, JointOwners
from head_tracking.dynamixel import JointConfiguration
from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit.head_claim import LOOK_TIME, HeadClaim, KeptStop, is_heard_elsewhere
from head_tracking.ros.kit.joint_owners import resume_report, stop_report
from head_tracking.ros.kit.node_parameters import check_parameters
from head_tracking.ros.kit.spinning import ClosingNode, NodeThreads, describe, ros_threads
from head_tracking.ros.kit.stop_signal import EndRequestedError, StopSignal
from head_tracking.ros.kit.threads import UrgentServices
from head_tracking.run.child import SupervisorLink
from head_tracking.run.node_sets import (
    CONTROL,
    FEEDS_BUFFER,
    MODES,
    PAGE,
    STARTED_ON_REQUEST,
    VIEWER,
    NodeSpec,
)
from head_tracking.run.options import Run, parse_arguments
from head_tracking.run.run_monitor import RunMonitor
from head_tracking.run.status_line import StatusLine
from head_tracking.run.stop_key import HINT, STOP
from head_tracking.tf import Buffer, TransformListener, prefix_of
from head_tracking.transforms.urdf import parse_in_child_process

_START_TIMEOUT = 30.0  # s for a node of another process, on a busy machine
_POLL = 0.1  # s


class Composition:
    """The nodes of a run, which run together in this process.

    Args:
        stop: ends the start between two nodes.
        start_elsewhere: starts the nodes of other processes; None: all nodes run in this process.
        on_servos: is called once `servo_bus` runs, before anything is commanded.

    Raises:
        EndRequestedError: `stop` was set.
        Exception: a node cannot start.

    Attributes:
        nodes: by name.
        buffer: the transforms that they use together.
        loop: the control loop in the cycle of the servo bus.
        simulated: the servos of each joint, if they are simulated in this process.
    """

    def __init__(
        self,
        plan: Run,
        threads: NodeThreads,
        stop: StopSignal,
        start_elsewhere: Callable[[NodeSpec], None] | None = None,
        on_servos: Callable[[Composition], object] = lambda _: None,
        owners: JointOwners | None = None,
    ) -> None:
        self.nodes: dict[str, Any] = {}
        self.buffer = Buffer()
        self.loop = ControlLoop(self.buffer.core, owners)
        self.simulated: dict[str, SimulatedJoints] = {}
        self._threads, self._start_elsewhere = threads, start_elsewhere
        self._starting = threading.Lock()
        self._available: dict[str, Any] = {
            "buffer": self.buffer,
            "loop": self.loop,
            "simulate": self._simulate if plan.options.sim else None,
        }
        for spec in plan.nodes:
            stop.check()
            self._start(spec)
            if spec is plan.nodes[0]:
                servo_bus = self.nodes[spec.name]
                on_servos(self)
                if all(other.name != FEEDS_BUFFER for other in plan.nodes):
                    TransformListener(self.buffer, servo_bus, frame_prefix=prefix_of(servo_bus))

    def _start(self, spec: NodeSpec) -> None:
        """Start a node, unless it runs."""
        with self._starting:
            if spec.process == PAGE:  # the supervisor has started it
                self._offer_starts(self.nodes["servo_bus"])
            elif spec.process != CONTROL and self._start_elsewhere is not None:
                self._start_elsewhere(spec)
            elif spec.name not in self.nodes:
                self.nodes[spec.name] = spec.make(self._available)
                self._threads.start(self.nodes[spec.name])

    def _start_on_request(self, spec: NodeSpec, _: Trigger.Request) -> str:
        try:
            self._start(spec)
        except EndRequestedError:
            raise HeadTrackingError("the run ends") from None
        return f"{spec.name} is running"

    def _offer_starts(self, node: ClosingNode) -> None:
        """Offer the service `node_starter/NAME` for each node that the page can start."""
        services = UrgentServices(node)
        for spec in STARTED_ON_REQUEST:
            services.offer(f"node_starter/{spec.name}", partial(self._start_on_request, spec))
        node.closing.callback(services.close)
        services.start()

    def _simulate(self, joints: Sequence[JointConfiguration]) -> Callable[[str, int], Any]:
        simulated = SimulatedJoints(joints)
        self.simulated |= {joint.joint_name: simulated for joint in joints}
        return simulated.open


class ControlProcess:
    """The run as the control process sees it: nodes, keys, status line."""

    def __init__(
        self, plan: Run, stop: StopSignal, link: SupervisorLink, status: StatusLine
    ) -> None:
        self._plan, self._stop, self._link, self._status = plan, stop, link, status
        self._starting: dict[str, futures.Future[str]] = {}
        self._reported_servos: list[Any] = []
        self._hint: list[str] = []
        self._page = ["the page starts"] if VIEWER in plan.nodes else []
        self._head: Composition  # once its servos are ready; no key comes before

    def run(self, threads: NodeThreads, kept: KeptStop | None) -> None:
        """Run until `stop`, or until the duration of the plan is over.

        Raises:
            RefusedError: another head runs.
            EndRequestedError: `stop` was set before all nodes had started.
            Exception: a node cannot start, or has died.
        """
        plan = self._plan
        claim = self._claim(threads)
        threading.Thread(target=self._receive, daemon=True).start()
        owners = JointOwners(exclusive=not plan.options.allow_others)
        if kept is not None:
            kept.guard(owners)
        head = Composition(
            plan, threads, self._stop, self._start_elsewhere, self._on_servos, owners
        )
        check_parameters(list(head.nodes.values()))
        head_node = head.nodes.get(MODES[plan.options.mode].name)
        monitor = RunMonitor(
            head_node.control if head_node else None,
            head.nodes["servo_bus"].backend.threads,
            (lambda joint: head.simulated[joint].true_position(joint)) if head.simulated else None,
        )

        def update() -> None:
            if not plan.options.allow_others:
                claim.check()
            self._report_servos()
            stopped = ["STOPPED"] if owners.stopped else []
            self._status.show([*self._hint, *stopped, *self._page, *monitor.update()])

        try:
            threads.wait(self._stop, plan.options.duration, update)
        finally:
            summary = monitor.summary()
            threads.close()  # the last log messages of the nodes come before the summary
            self._status.end(summary)

    def _claim(self, threads: NodeThreads) -> HeadClaim:
        """Claim the head before anything else is published."""
        node = Node("head_claim", start_parameter_services=False, enable_rosout=False)
        claim = HeadClaim(node, simulated=self._plan.options.sim)
        threads.start(node)
        if not self._plan.options.allow_others and is_heard_elsewhere(os.environ):
            self._status.show(["searching for other heads"])
            self._stop.wait(LOOK_TIME)
            self._stop.check()
            claim.check()
        claim.begin()
        return claim

    def _on_servos(self, head: Composition) -> None:
        """Accept keys from now on: other programs may turn the head while nodes still start."""
        self._head = head
        self._report_servos()
        self._link.send(ready=True)

    def _report_servos(self) -> None:
        """Report the present servos, which the supervisor relaxes if this process dies."""
        servos = self._head.nodes["servo_bus"].servos_by_port()
        if not self._plan.options.sim and servos != self._reported_servos:
            self._reported_servos = servos
            self._link.send(servos=servos)

    def _start_elsewhere(self, spec: NodeSpec) -> None:
        """Start a node in another process, and wait until it runs.

        Raises:
            HeadTrackingError: the node cannot start.
            EndRequestedError: the run ends meanwhile.
        """
        started = self._starting[spec.name] = futures.Future()
        self._link.send(**asdict(spec))
        for _ in range(round(_START_TIMEOUT / _POLL)):
            self._status.show([*self._hint, f"{spec.name} starts"])
            futures.wait([started], _POLL)
            self._stop.check()
            if started.done():
                break
        problem = started.result() if started.done() else f"no answer in {_START_TIMEOUT:g} s"
        if problem:
            raise HeadTrackingError(problem)

    def _receive(self) -> None:
        """Handle the messages of the supervisor, in a thread."""
        while True:
            message = self._link.messages.get()
            if "node" in message:
                if message["node"] == VIEWER.name:  # it serves now, or cannot start
                    self._page = []
                if (started := self._starting.pop(message["node"], None)) is not None:
                    started.set_result(message["problem"])
            elif "keys" in message:
                self._hint = [HINT] if message["keys"] else []
            else:  # in a thread: STOP waits for nothing
                threading.Thread(target=self._press, args=[message["key"]], daemon=True).start()

    def _press(self, key: str) -> None:
        """Stop or resume, and print the result."""
        head = self._head
        try:
            if key == STOP:
                result = f"STOP: {stop_report(head.loop.stop())}; r resumes"
            else:
                result = f"resumed: {resume_report(*head.nodes['servo_bus'].backend.resume())}"
        except Exception as error:
            failure = "STOP: NOT confirmed" if key == STOP else "not resumed"
            result = f"{failure}: {describe(error)}"
        if key == STOP:
            self._link.send(stopped=True)  # whether or not the servos have confirmed it
        self._status.print(result)


def run_control(arguments: Sequence[str], stop: StopSignal, link: SupervisorLink) -> int:
    """Run the control process of a command line until `stop`; return the exit code."""
    parse_in_child_process()
    status = StatusLine()
    try:
        plan = parse_arguments(arguments)
        with ros_threads(plan.ros_arguments) as threads:
            kept = KeptStop(plan.arguments) if plan.options.keep_stop else None
            ControlProcess(plan, stop, link, status).run(threads, kept)
        if kept is not None and not (threads.problems or link.has_crashed):
            kept.forget()
    except EndRequestedError:
        status.end("stopped during the start")
    except Exception as error:
        status.end("")
        print(f"head_tracking: {describe(error)}", file=sys.stderr)
        return 1
    finally:
        link.send(servos=[])  # they are relaxed, or the output names those that are not
    return 1 if threads.problems else 0
