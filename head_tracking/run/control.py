"""The control process: servo bus, head and their ROS interface, by one loop."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from typing import Any

import rclpy
from rclpy.logging import get_logger
from rclpy.node import Node

from head_tracking.control import ControlLoop, JointOwners
from head_tracking.dynamixel import JointConfiguration
from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit import parameter_sources
from head_tracking.ros.kit.head_claim import LOOK_TIME, HeadClaim, is_heard_elsewhere
from head_tracking.ros.kit.joint_owners import resume_report, stop_report
from head_tracking.ros.kit.kept_stop import KeptStop
from head_tracking.ros.kit.spinning import NodeThreads, describe
from head_tracking.ros.kit.start import start_ros
from head_tracking.ros.kit.stop_signal import EndRequestedError, StopSignal
from head_tracking.run.child import SupervisorLine
from head_tracking.run.node_sets import CONTROL, FEEDS_BUFFER, PAGE, NodeSpec, started_on_request
from head_tracking.run.options import Run, parse_arguments
from head_tracking.run.run_monitor import RunMonitor
from head_tracking.run.status_line import StatusLine
from head_tracking.run.stop_key import HINT, carry_out
from head_tracking.run.true_positions import TruePositionsOutput
from head_tracking.simulation import SimulatedJoints
from head_tracking.tf import Buffer, TransformListener

_START_PATIENCE = 30.0  # s for a node of another process, on a busy machine
_POLL = 0.1  # s


class ArgumentError(HeadTrackingError):
    """A mistake on the command line that shows when the servos are known."""


class NodeNotStartedError(HeadTrackingError):
    """A node of another process cannot start; the message says why."""


@dataclass(frozen=True, slots=True)
class Composition:
    """Nodes that run together.

    Attributes:
        nodes: by name.
        buffer: the transforms that they share.
        loop: what they do in each cycle of the servo bus.
        simulated: the servos, if they are simulated in this process.
        true_position: where a joint really is [rad], or None if no servo turns it; None if the
            servos are not simulated.
    """

    nodes: Mapping[str, Any]
    buffer: Buffer
    loop: ControlLoop
    simulated: SimulatedJoints | None
    true_position: Callable[[str], float | None] | None

    def stop(self) -> list[str]:
        """STOP; return a line for each joint."""
        problems = self.loop.stop()
        return [stop_report(joint, problem) for joint, problem in problems.items()]

    def resume(self) -> list[str]:
        """End a STOP; return a line that says who goes on."""
        return [resume_report(self.nodes["servo_bus"].backend.resume())]


def compose(
    plan: Run,
    threads: NodeThreads,
    resources: ExitStack,
    stop: StopSignal,
    start_elsewhere: Callable[[NodeSpec], None] | None = None,
    on_servos: Callable[[Any], object] = lambda _: None,
    owners: JointOwners | None = None,
) -> Composition:
    """Make the nodes of a run and start them.

    Args:
        plan: which nodes.
        threads: spins them; must be closed before `resources`.
        resources: gets the simulated servos, if there are any.
        stop: asks to stop while there are nodes to make.
        start_elsewhere: starts the nodes of other processes; None: they are made here.
        on_servos: gets the servo bus before anything is commanded.
        owners: of the joints; None: new ones, as planned.

    Raises:
        EndRequestedError: somebody asked to stop.
        ArgumentError: there is no such joint to reverse.
        Exception: a node could not start; says why.
    """
    buffer = Buffer()
    loop = ControlLoop(buffer.core, owners or JointOwners(exclusive=not plan.allow_others))
    simulated: list[SimulatedJoints] = []

    def simulate(joints: Sequence[JointConfiguration]) -> str:
        simulated.append(resources.enter_context(SimulatedJoints(joints)))
        return simulated[0].port_name

    def true_position(joint: str) -> float | None:
        direction = -1.0 if joint in plan.reversed else 1.0
        try:
            return direction * simulated[0].true_position(joint)
        except KeyError:  # no servo turns it, and it will not be measured
            return None

    nodes: dict[str, Any] = {}
    on_request = started_on_request(simulated=plan.simulated)
    elsewhere: set[str] = set()

    def start(spec: NodeSpec) -> None:
        if spec.process != CONTROL and start_elsewhere is not None:
            elsewhere.add(spec.name)
            start_elsewhere(spec)
            return
        nodes[spec.name] = spec.make(shared)
        threads.start(nodes[spec.name])

    def start_on_request(name: str) -> None:
        if name not in nodes and name not in elsewhere:
            start(on_request[name])

    shared: dict[str, Any] = {
        "buffer": buffer,
        "loop": loop,
        "connect": simulate if plan.simulated else None,
        "start": start_on_request,
        "startable": tuple(on_request),
        "true_position": true_position if plan.simulated else None,
    }
    for spec in plan.nodes:
        stop.check()
        start(spec)
        if spec is plan.nodes[0]:
            servo_bus = nodes[spec.name]
            on_servos(servo_bus)
            driven = [servo.joint_name for servo in servo_bus.status().statistics.servos]
            _check_reversed(plan.reversed, driven)
            if all(other.name != FEEDS_BUFFER for other in plan.nodes):
                TransformListener(buffer, servo_bus)
            if plan.simulated and start_elsewhere is not None:
                TruePositionsOutput(servo_bus, driven, true_position)
    return Composition(
        nodes, buffer, loop, simulated[0] if simulated else None, shared["true_position"]
    )


def _check_reversed(joints: Sequence[str], driven: Sequence[str]) -> None:
    unknown = ", ".join(joint for joint in joints if joint not in driven)
    if unknown:
        raise ArgumentError(f"--reverse: no servo turns {unknown}; there are {', '.join(driven)}")


class OtherProcesses:
    """Starts nodes in the processes beside this one.

    Args:
        line: to the supervisor.
        stop: ends waiting.
    """

    def __init__(self, line: SupervisorLine, stop: StopSignal) -> None:
        self._line, self._stop = line, stop
        self._reports: dict[str, str] = {}
        self._changed = threading.Condition()

    def start(self, spec: NodeSpec) -> None:
        """Start a node and wait until it runs; the supervisor has started the page.

        Raises:
            NodeNotStartedError: it cannot; says why.
            EndRequestedError: somebody asked to stop meanwhile.
        """
        if spec.process == PAGE:
            return
        with self._changed:
            self._reports.pop(spec.name, None)
            self._line.send(enabled=True, **asdict(spec))
            for _ in range(round(_START_PATIENCE / _POLL)):
                self._changed.wait(_POLL)
                self._stop.check()
                if spec.name in self._reports:
                    break
            problem = self._reports.get(spec.name, f"no answer within {_START_PATIENCE:g} s")
        if problem:
            raise NodeNotStartedError(problem)

    def received(self, report: dict[str, Any]) -> None:
        """Record what another process reports of a node."""
        with self._changed:
            self._reports[report["node"]] = report["problem"]
            self._changed.notify_all()


def run_control(arguments: Sequence[str], stop: StopSignal, line: SupervisorLine) -> int:
    """Run the control process until it is time to stop; return the exit code.

    Args:
        arguments: the command line of the run.
        stop: asks to stop.
        line: to the supervisor.
    """
    status = StatusLine()
    threads = NodeThreads()
    try:
        plan = parse_arguments(arguments)
        start_ros(plan.ros_arguments)
        with ExitStack() as resources, closing(threads):
            kept = KeptStop(plan.arguments) if plan.keeps_stop else None
            _run(plan, threads, resources, stop, status, line, kept)
            if kept is not None and threads.exit_code() == 0:
                kept.forget()
    except EndRequestedError:
        status.end("stopped before everything had started")
    except Exception as error:
        status.end(f"head_tracking: {describe(error)}")
        return 2 if isinstance(error, ArgumentError) else 1
    finally:
        line.send(servos=[])  # they are relaxed, or it was said which are not
        rclpy.try_shutdown()
    return threads.exit_code()


def _claim(plan: Run, threads: NodeThreads, stop: StopSignal, status: StatusLine) -> HeadClaim:
    """Claim the head before anything else is published.

    Raises:
        RefusedError: another head has it.
        EndRequestedError: somebody asked to stop.
    """
    node = Node("head_claim", start_parameter_services=False, enable_rosout=False)
    claim = HeadClaim(node, simulated=plan.simulated)
    threads.start(node)
    if not plan.allow_others and is_heard_elsewhere(os.environ):
        status.show(["looking for other heads"])
        stop.wait(LOOK_TIME)
        stop.check()
        claim.check()
    claim.begin()
    return claim


def _run(
    plan: Run,
    threads: NodeThreads,
    resources: ExitStack,
    stop: StopSignal,
    status: StatusLine,
    line: SupervisorLine,
    kept: KeptStop | None,
) -> None:
    handed_over: list[Any] = []

    def hand_over(servo_bus: Any) -> None:
        """Tell the supervisor which servos there are now; simulated ones end with this process."""
        servos = servo_bus.servos_by_port()
        if not plan.simulated and servos != handed_over:
            handed_over[:] = servos
            line.send(servos=servos)

    hint: list[str] = []

    def receive(message: dict[str, Any]) -> None:
        if "node" in message:
            others.received(message)
        elif "keys" in message:
            hint[:] = [HINT] if message["keys"] else []
        elif message["key"]:  # in a thread: the end of the line must be noticed meanwhile
            threading.Thread(target=press, args=[message["key"]], daemon=True).start()

    def press(key: str) -> None:
        status.say(carry_out(key, head.stop, head.resume))

    claim = _claim(plan, threads, stop, status)
    others = OtherProcesses(line, stop)
    line.receive(receive)
    owners = JointOwners(exclusive=not plan.allow_others)
    if kept is not None:
        kept.guard(owners)
    head = compose(plan, threads, resources, stop, others.start, hand_over, owners)
    parameter_sources.check(head.nodes.values())
    get_logger("head_tracking").info(threads.executor)
    head_node = head.nodes.get(plan.head_node)
    monitor = RunMonitor(
        head_node.interface.control if head_node else None,
        head.nodes["servo_bus"].status,
        head.true_position,
        lambda: head.loop.owners.stopped,
    )

    def look() -> None:
        if not plan.allow_others:
            claim.check()
        hand_over(head.nodes["servo_bus"])
        parts, mood = monitor.look()
        status.show([*parts, *hint], mood)

    line.send(ready=True)
    try:
        threads.wait(stop, plan.duration, look)
    finally:
        summary = monitor.summary()
        threads.close()  # what the nodes say at the end stands above
        status.end(summary)
