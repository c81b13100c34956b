"""The command line of the program head_tracking; it knows no ROS."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from head_tracking.command_line import point_in_frame, seconds, with_points
from head_tracking.page import MISSING, installed
from head_tracking.programs import COMMANDS
from head_tracking.run.node_sets import (
    HEAD,
    LEFT_OUT,
    MODES,
    ROBOT,
    SCENES,
    SIMULATED_PORT,
    STARTER,
    TARGETS,
    VIEWER,
    NodeSpec,
    fixed_target,
    frame_target,
    simulated_camera,
)
from head_tracking.share import robot_parameters


@dataclass(frozen=True, slots=True)
class Run:
    """A run, as the command line describes it.

    Attributes:
        nodes: the nodes to start, in order.
        head_node: the name of the one that turns the head; empty: none does.
        simulated: whether the servos are simulated.
        parameter_files: for all nodes; later ones win.
        duration: how long to run [s]; None: until a signal.
        arguments: the command line, ROS's own arguments among it.
        allow_others: whether it starts and goes on beside other heads; the last command wins then.
        keeps_to_itself: whether other machines do not hear of it.
        hold_on_crash: whether the servos hold, instead of relaxing, if the control process dies.
        keeps_stop: whether a head that was stopped when its last run crashed begins stopped.
        reversed: joints whose simulated servos are mounted the wrong way round.
    """

    nodes: tuple[NodeSpec, ...]
    head_node: str
    simulated: bool
    parameter_files: tuple[Path, ...]
    duration: float | None
    arguments: tuple[str, ...]
    allow_others: bool
    keeps_to_itself: bool
    hold_on_crash: bool
    keeps_stop: bool
    reversed: tuple[str, ...]

    @property
    def ros_arguments(self) -> list[str]:
        """Return what `rclpy.init` gets in each process: parameter files, and ROS's arguments."""
        files = [word for file in self.parameter_files for word in ("--params-file", str(file))]
        return ["--ros-args", *files, "--", *self.arguments]


def parse_arguments(arguments: Sequence[str]) -> Run:
    """Return the run that a command line describes; after a mistake exit with code 2."""
    parser = argparse.ArgumentParser(
        prog="head_tracking",
        description="Runs a pan/tilt head: servo bus, transforms, and pointing or tracking.",
        epilog=f"head_tracking COMMAND runs one of {', '.join(COMMANDS)}; see COMMAND --help. "
        "ROS's own arguments follow --ros-args. A simulated run keeps to this machine, "
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
        "--calibration",
        type=_existing_file,
        metavar="FILE",
        help="what `head_tracking calibrate` has measured, applied to the robot's model",
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
        metavar=f"{'|'.join(TARGETS)}|x,y,z@frame|@frame",
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
        help="start, and go on, although another head has this ROS domain and namespace; the last "
        "command wins",
    )
    parser.add_argument(
        "--network", action="store_true", help="let other machines hear a simulated run, too"
    )
    parser.add_argument(
        "--on-crash",
        choices=("relax", "hold"),
        default="relax",
        help="what happens to the servos if the process that drives them dies "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--keep-stop",
        action="store_true",
        help="begin stopped if the run before was stopped and crashed: for what starts the head "
        "again by itself, as systemd does",
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
    options = parser.parse_args(with_points(list(_without_ros_arguments(arguments))))
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
        "robot_state_publisher": {
            "robot": options.robot,
            "calibration": str(options.calibration or ""),
        },
        "servo_bus": SIMULATED_PORT if options.sim else port,
    }
    head = MODES[options.mode]
    left_out = {head.name if name == HEAD else name for name in options.without}
    page = [STARTER, VIEWER] if options.viewer else []
    nodes = [
        replace(node, parameters={**node.parameters, **overrides.get(node.name, {})})
        for node in (*ROBOT, head, *targets, *page)
        if node.name not in left_out
    ]
    return Run(
        tuple(nodes),
        "" if head.name in left_out else head.name,
        options.sim,
        (*robot_parameters(options.robot), *options.params),
        options.duration,
        tuple(arguments),
        options.allow_others,
        options.sim and not options.network,
        options.on_crash == "hold",
        options.keep_stop,
        tuple(options.reverse),
    )


def _without_ros_arguments(arguments: Sequence[str]) -> Iterator[str]:
    """Yield what is not between `--ros-args` and `--`, as rclpy does."""
    ros = False
    for word in arguments:
        if word == "--ros-args":
            ros = True
        elif ros and word == "--":
            ros = False
        elif not ros:
            yield word


def _target(text: str) -> tuple[tuple[NodeSpec, ...], str]:
    """Return the nodes that publish a target, and the scene that a simulated camera needs."""
    if text in TARGETS:
        return TARGETS[text], SCENES.get(text, "")
    if text.startswith("@") and text != "@":
        return frame_target(text[1:]), ""
    try:
        return fixed_target(*point_in_frame(text)), ""
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no target; give {', '.join(TARGETS)}, a frame such as @gripper_link, "
            "or a point in metres and its frame such as 1,0.5,0@base_link"
        ) from None


def _existing_file(text: str) -> Path:
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"there is no file {text}")
    return path
