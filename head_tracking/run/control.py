"""head_tracking: all nodes of a head in one process, by one command."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from rclpy.logging import get_logger
from rclpy.parameter import Parameter

from head_tracking.command_line import point_in_frame, seconds, with_points
from head_tracking.control import ControlLoop, JointOwners
from head_tracking.dynamixel import JointConfiguration
from head_tracking.exceptions import HeadTrackingError
from head_tracking.nodes.viewer import MISSING, installed
from head_tracking.ros import parameter_files
from head_tracking.ros.graph_watch import GraphWatch, own_enclave
from head_tracking.ros.joint_owners import resume_report, stop_report
from head_tracking.ros.listening import listen_for
from head_tracking.ros.spinning import NodeThreads, describe
from head_tracking.ros.start import start_ros, without_ros_arguments
from head_tracking.ros.stop_signal import StoppedError, StopSignal
from head_tracking.run.node_sets import (
    BUS_PROCESS,
    FEEDS_BUFFER,
    HEAD,
    LEFT_OUT,
    MODES,
    ROBOT,
    SCENES,
    SIMULATED_PORT,
    STARTER,
    TARGETS,
    NodeSpec,
    fixed_target,
    simulated_camera,
    started_on_request,
)
from head_tracking.run.run_monitor import RunMonitor, RunSources
from head_tracking.run.status_line import StatusLine
from head_tracking.run.stop_key import HINT, StopKey
from head_tracking.share import robot_parameters
from head_tracking.simulation import SimulatedJoints
from head_tracking.tf import Buffer
from head_tracking.viewer_process import viewer_process

_LOOK_PERIOD = 0.1  # s
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


class ArgumentError(HeadTrackingError):
    """A mistake on the command line that shows when the servos are known."""


@dataclass(frozen=True, slots=True)
class Run:
    """What a person asked for.

    Attributes:
        nodes: the nodes to start, in order.
        head_node: the one that turns the head; empty: none does.
        simulated: the servos are simulated.
        parameter_files: for all nodes; later ones win.
        duration: how long to run [s]; None: until somebody stops it.
        viewer: show it in a browser.
        arguments: the command line, ROS's own arguments among it.
        enclave: by which its processes know each other; see `GraphWatch`.
        allow_others: other heads in the graph keep it from nothing, and the last command wins.
        keeps_to_itself: no other machine hears of it.
        reversed: joints whose simulated servos are mounted the wrong way round.
    """

    nodes: tuple[NodeSpec, ...]
    head_node: str
    simulated: bool
    parameter_files: tuple[Path, ...]
    duration: float | None
    viewer: bool
    arguments: tuple[str, ...]
    enclave: str
    allow_others: bool
    keeps_to_itself: bool
    reversed: tuple[str, ...]


def parse_arguments(arguments: Sequence[str]) -> Run:
    """The run that the command line describes; on a mistake the process ends with code 2."""
    parser = argparse.ArgumentParser(
        prog="head_tracking",
        description="Runs a pan/tilt head: servo bus, transforms, and pointing or tracking.",
        epilog="ROS's own arguments follow --ros-args. A simulated run keeps to this machine, "
        "unless ROS_AUTOMATIC_DISCOVERY_RANGE says something else.",
    )
    servos = parser.add_mutually_exclusive_group()
    servos.add_argument("--sim", action="store_true", help="simulate the servos")
    servos.add_argument("--port", metavar="DEV", help="serial port (default: /dev/ttyUSB0)")
    parser.add_argument(
        "--robot",
        default="kinectbot",
        metavar="NAME|FILE",
        help="its name, or a URDF or xacro file (default: %(default)s)",
    )
    parser.add_argument(
        "--mode",
        choices=sorted(MODES),
        default="track",
        help="keep the head on the target, or turn it to each target once (default: %(default)s)",
    )
    parser.add_argument(
        "--target",
        type=_target,
        metavar=f"{'|'.join(TARGETS)}|x,y,z@frame",
        help="what to look at besides what others publish on /target_point "
        "(default: fictitious for --sim --mode track, else none)",
    )
    parser.add_argument(
        "--params",
        action="append",
        type=_existing_file,
        default=[],
        metavar="FILE",
        help="parameters in YAML, over the robot's own; can be given several times",
    )
    parser.add_argument(
        "--bus-process",
        action="store_true",
        help="give the servo bus a process of its own, which no busy thread can delay",
    )
    parser.add_argument(
        "--without",
        action="append",
        choices=sorted(LEFT_OUT),
        default=[],
        metavar="NODE",
        help="leave out what the robot has already: joint_state_publisher, robot_state_publisher, "
        "or head (what turns it); can be given several times",
    )
    parser.add_argument(
        "--allow-others",
        action="store_true",
        help="start, and go on, although another head, or another publisher of joint_commands, is "
        "in the graph",
    )
    parser.add_argument(
        "--network", action="store_true", help="let other machines hear a simulated run, too"
    )
    parser.add_argument(
        "--reverse",
        action="append",
        default=[],
        metavar="JOINT",
        help="with --sim: mount this joint's servo the wrong way round, to see what is said of it",
    )
    parser.add_argument("--duration", type=seconds, metavar="S", help="end after S seconds")
    parser.add_argument(
        "--viewer", action="store_true", help="show the head in a browser, and steer it there"
    )
    options = parser.parse_args(with_points(without_ros_arguments([parser.prog, *arguments])[1:]))
    if options.viewer and not installed():
        parser.error(MISSING)
    if options.reverse and not options.sim:
        parser.error("--reverse is for simulated servos: add --sim")
    if options.target is None:
        options.target = _target(
            "fictitious" if options.sim and options.mode == "track" else "none"
        )
    targets, scene = options.target
    if options.sim and scene:
        targets = (simulated_camera(scene), *targets)
    port = {"port_name": options.port} if options.port else {}
    overrides = {
        "robot_state_publisher": {"robot": options.robot},
        "servo_bus": SIMULATED_PORT if options.sim else port,
    }
    head = MODES[options.mode]
    starter = [STARTER] if options.viewer else []
    servo_bus, *publishers = ROBOT
    if options.bus_process:
        servo_bus = BUS_PROCESS
    left_out = {head.name if name == HEAD else name for name in options.without}
    nodes = [
        replace(node, parameters={**node.parameters, **overrides.get(node.name, {})})
        for node in (servo_bus, *publishers, head, *targets, *starter)
        if node.name not in left_out
    ]
    return Run(
        tuple(nodes),
        "" if head.name in left_out else head.name,
        options.sim,
        (*robot_parameters(options.robot), *options.params),
        options.duration,
        options.viewer,
        tuple(arguments),
        _said_enclave(arguments) or own_enclave(simulated=options.sim),
        options.allow_others,
        options.sim and not options.network,
        tuple(options.reverse),
    )


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
        problems = self.nodes["servo_bus"].stop()
        return [stop_report(joint, problem) for joint, problem in problems.items()]

    def resume(self) -> list[str]:
        """End a STOP; return a line that says who goes on."""
        return [resume_report(self.nodes["servo_bus"].resume())]


def compose(
    plan: Run, threads: NodeThreads, resources: ExitStack, stop: StopSignal, held: str = ""
) -> Composition:
    """Makes the nodes of a run and starts them.

    Args:
        plan: which nodes.
        threads: spins them; must be closed before `resources`.
        resources: gets the simulated servos, if there are any.
        stop: asks to stop while there are nodes to make.
        held: why nothing may move yet; see `ControlLoop.hold`.

    Raises:
        StoppedError: somebody asked to stop.
        ArgumentError: there is no such joint to reverse.
        Exception: a node could not start; says why.
    """
    buffer = Buffer()
    loop = ControlLoop(buffer.core, JointOwners(exclusive=not plan.allow_others))
    loop.hold(held)
    simulated: list[SimulatedJoints] = []

    def simulate(joints: Sequence[JointConfiguration]) -> str:
        simulated.append(resources.enter_context(SimulatedJoints(joints)))
        return simulated[0].port_name

    def true_position(joint: str) -> float | None:
        servos = simulated[0] if simulated else nodes["servo_bus"]
        way = -1.0 if joint in plan.reversed else 1.0
        try:
            return way * float(servos.true_position(joint))
        except KeyError:  # no servo turns it, and it will not be measured
            return None

    nodes: dict[str, Any] = {}
    on_request = started_on_request(simulated=plan.simulated)

    def start(spec: NodeSpec) -> None:
        overrides = [Parameter(name, value=value) for name, value in spec.parameters.items()]
        handed = {name: shared[name] for name in spec.takes}
        nodes[spec.name] = spec.make(parameter_overrides=overrides, **handed)
        threads.start(nodes[spec.name])

    def start_on_request(name: str) -> None:
        if name not in nodes:
            start(on_request[name])

    shared: dict[str, Any] = {
        "buffer": buffer,
        "loop": loop,
        "connect": simulate if plan.simulated else None,
        "start": start_on_request,
        "startable": tuple(on_request),
        "true_position": true_position if plan.simulated else None,
        "simulated": plan.simulated,
        "arguments": ros_arguments(plan),
        "stop": stop,
    }
    for spec in plan.nodes:
        stop.check()
        start(spec)
        if spec is plan.nodes[0]:
            _check_reversed(plan.reversed, nodes[spec.name])
            if all(other.name != FEEDS_BUFFER for other in plan.nodes):
                listen_for(loop, buffer, nodes[spec.name])
    return Composition(
        nodes, buffer, loop, simulated[0] if simulated else None, shared["true_position"]
    )


def _check_reversed(joints: Sequence[str], servo_bus: Any) -> None:
    driven = [servo.joint_name for servo in servo_bus.status().statistics.servos]
    unknown = ", ".join(joint for joint in joints if joint not in driven)
    if unknown:
        raise ArgumentError(f"--reverse: no servo turns {unknown}; there are {', '.join(driven)}")


def _look_around(watch: GraphWatch, stop: StopSignal, line: StatusLine) -> None:
    """Looks for other heads before there is anything to hear of this one.

    A real head would take a simulated one's target and joints for its own.

    Raises:
        RefusedError: there is another head.
        StoppedError: somebody asked to stop.
    """
    while not watch.alone:
        stop.check()
        watch.look()
        line.show([watch.held])
        stop.wait(_LOOK_PERIOD)


def run(plan: Run, stop: StopSignal, line: StatusLine) -> int:
    """Runs the nodes until it is time to stop.

    Returns:
        The exit code: 1 if something went wrong at the end, such as servos not known to be relaxed.

    Raises:
        NodeDied: a node ended with an error.
        Exception: a node could not start.
    """
    threads = NodeThreads()
    try:
        with ExitStack() as resources, closing(threads):
            _run(plan, threads, resources, stop, line)
    except StoppedError:
        line.end("stopped before everything had started")
    return threads.exit_code()


def _run(
    plan: Run, threads: NodeThreads, resources: ExitStack, stop: StopSignal, line: StatusLine
) -> None:
    watch = GraphWatch(plan.enclave, simulated=plan.simulated, allow_others=plan.allow_others)
    if plan.simulated:
        _look_around(watch, stop, line)
    head = compose(plan, threads, resources, stop, watch.held)
    if plan.viewer:
        resources.enter_context(viewer_process(ros_arguments(plan)))
    parameter_files.check(head.nodes.values())
    get_logger("head_tracking").info(threads.executor)
    head_node = head.nodes.get(plan.head_node)
    monitor = RunMonitor(
        RunSources(
            head=head_node.interface if head_node else None,
            bus_status=head.nodes["servo_bus"].status,
            true_position=head.true_position,
            held=lambda: head.loop.held,
            stopped=lambda: head.loop.owners.stopped,
        )
    )

    def look() -> None:
        watch.look()
        if watch.looking and watch.alone:
            watch.begin(head.nodes["servo_bus"])
        head.loop.hold(watch.held)
        parts, mood = monitor.look()
        line.show([*parts, HINT] if key.works else parts, mood)

    key = resources.enter_context(StopKey(head.stop, head.resume, line.say))
    try:
        threads.wait(stop, plan.duration, look)
    finally:
        summary = monitor.summary()
        threads.close()  # what the nodes say at the end stands above
        line.end(summary)


def main(arguments: Sequence[str], stop: StopSignal) -> int:
    """Runs the head until somebody stops it; returns the exit code."""
    line = StatusLine()
    line.prepare_logging()
    try:
        plan = parse_arguments(arguments)
        # A colleague's head is not this run's to turn, and ROS's own setup.bash says SUBNET.
        if plan.keeps_to_itself and os.environ.get(_RANGE, "SUBNET") in ("", "SUBNET"):
            os.environ[_RANGE] = "LOCALHOST"
        start_ros(ros_arguments(plan))
        return run(plan, stop, line)
    except Exception as error:
        line.end(f"head_tracking: {describe(error)}")
        return 2 if isinstance(error, ArgumentError) else 1
    finally:
        rclpy.try_shutdown()


def ros_arguments(plan: Run) -> list[str]:
    """What `rclpy.init` must be told of a run: its parameter files, and what a person said."""
    said = [["--params-file", str(file)] for file in plan.parameter_files]
    if plan.enclave:  # a person's own, in the arguments, wins
        said.append(["--enclave", plan.enclave])
    return ["--ros-args", *(word for words in said for word in words), "--", *plan.arguments]


def _target(text: str) -> tuple[tuple[NodeSpec, ...], str]:
    """The nodes that publish a target, and the scene that a simulated camera needs for it."""
    if text in TARGETS:
        return TARGETS[text], SCENES.get(text, "")
    try:
        return fixed_target(*point_in_frame(text)), ""
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no target; give {', '.join(TARGETS)}, or a point in metres and its "
            "frame such as 1,0.5,0@base_link"
        ) from None


def _said_enclave(arguments: Sequence[str]) -> str:
    """The enclave that a person gives among ROS's arguments; the last one counts."""
    said = [after for word, after in pairwise(arguments) if word in ("-e", "--enclave")]
    return said[-1] if said else ""


def _existing_file(text: str) -> Path:
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"there is no file {text}")
    return path
