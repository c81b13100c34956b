"""The command line of the program head_tracking; without ROS."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from head_tracking.command_line import (
    existing_file,
    point_in_frame,
    read_by,
    seconds,
    with_negative_values,
    without_ros_arguments,
)
from head_tracking.exceptions import HeadTrackingError
from head_tracking.page import MISSING, installed
from head_tracking.programs import COMMANDS, has_ros
from head_tracking.ros.kit.head_lock import node_name
from head_tracking.run.node_sets import (
    CAMERA,
    FEEDS_BUFFER,
    HEAD,
    LEFT_OUT,
    MODES,
    SCENES,
    TARGETS,
    VIEWER,
    NodeSpec,
    simulated_camera,
)
from head_tracking.share import NotInstalledError, robot_file, robot_parameters


@dataclass(frozen=True, slots=True)
class Run:
    """A run as described by the command line.

    Attributes:
        nodes: the nodes to start, in this order.
        options: the parsed options; see `--help`.
        arguments: the command line, including ROS arguments.
    """

    nodes: tuple[NodeSpec, ...]
    options: argparse.Namespace
    arguments: tuple[str, ...]

    @property
    def ros_arguments(self) -> list[str]:
        """Return the arguments of `rclpy.init`, with the parameter files; later ones win."""
        files = (*robot_parameters(self.options.robot), *self.options.params)
        words = [word for file in files for word in ("--params-file", str(file))]
        return ["--ros-args", *words, "--", *self.arguments]


def parse_arguments(arguments: Sequence[str]) -> Run:
    """Parse the command line; exit with code 2 after a mistake."""
    parser = argparse.ArgumentParser(
        prog="head_tracking",
        description="Runs a pan/tilt head: servo bus, transforms, and pointing or tracking.",
        epilog=f"head_tracking COMMAND runs one of {', '.join(COMMANDS)}; see COMMAND --help. "
        "ROS arguments follow --ros-args. Other machines do not discover a simulated run, "
        "unless ROS_AUTOMATIC_DISCOVERY_RANGE is set.",
    )
    servos = parser.add_mutually_exclusive_group()
    servos.add_argument("--sim", action="store_true", help="simulate the servos")
    servos.add_argument("--port", metavar="DEV", help="serial port (default: /dev/ttyUSB0)")
    parser.add_argument(
        "--robot",
        default="kinectbot",
        type=read_by(_robot, NotInstalledError),
        metavar="NAME|FILE",
        help="name of the robot, or a URDF or xacro file (default: %(default)s)",
    )
    parser.add_argument(
        "--calibration",
        type=existing_file,
        metavar="FILE",
        help="result of `head_tracking calibrate`, applied to the robot's model",
    )
    parser.add_argument(
        "--mode",
        choices=sorted(MODES),
        default="track",
        help="track the target, or point at each target once (default: %(default)s)",
    )
    parser.add_argument(
        "--target",
        type=_target,
        metavar=f"{'|'.join(TARGETS)}|x,y,z@frame|@frame",
        help="source of targets, besides other publishers of /target_point "
        "(default: fictitious for --sim --mode track, else none)",
    )
    parser.add_argument(
        "--params",
        action="append",
        type=read_by(_parameter_file, HeadTrackingError),
        default=[],
        metavar="FILE",
        help="YAML file with parameters that override the robot's; can be given several times",
    )
    parser.add_argument(
        "--without",
        action="append",
        choices=sorted(LEFT_OUT),
        default=[],
        metavar="NODE",
        help="omit a node that the robot already has: joint_state_publisher, "
        "robot_state_publisher, or head (its controller); can be given several times",
    )
    parser.add_argument(
        "--allow-others",
        action="store_true",
        help="run although another head has this ROS domain and namespace; the last command wins",
    )
    parser.add_argument(
        "--network", action="store_true", help="let other machines discover a simulated run"
    )
    parser.add_argument(
        "--on-crash",
        choices=("relax", "hold"),
        default="relax",
        help="what the servos do if the control process dies (default: %(default)s)",
    )
    parser.add_argument(
        "--keep-stop",
        action="store_true",
        help="start stopped if the last run was stopped when it crashed; for automatic restarts, "
        "such as by systemd",
    )
    parser.add_argument("--duration", type=seconds, metavar="S", help="end after S seconds")
    parser.add_argument(
        "--viewer", action="store_true", help="serve a page that shows and steers the head"
    )
    options = parser.parse_args(with_negative_values(without_ros_arguments(arguments)))
    if options.viewer and has_ros() and not installed():  # without ROS nothing runs
        parser.error(MISSING)
    if name := node_name(arguments, ""):
        parser.error(
            f"all nodes of the run would be named {name!r}, and have no parameters of their own; "
            "leave out -r __node:=, which name= in a launch file sets"
        )
    usual = "fictitious" if options.sim and options.mode == "track" else "none"
    targets, scene = options.target or _target(usual)
    page = [VIEWER] if options.viewer else []
    if options.sim and scene:
        targets = (simulated_camera(scene, shown=options.viewer), *targets)
    elif options.sim and options.viewer and find_spec("cv2") is not None:
        page.append(CAMERA)  # last: nothing else waits for it
    port = {} if options.port is None else {"port_name": options.port}
    model = {"robot": options.robot, "calibration": str(options.calibration or "")}
    head = MODES[options.mode]
    nodes = (
        NodeSpec("servo_bus", ("simulate", "loop"), port),
        NodeSpec(FEEDS_BUFFER, ("buffer", "loop"), model),
        NodeSpec("joint_state_publisher", ("loop",)),
        head,
        *targets,
        *page,
    )
    left_out = {head.name if name == HEAD else name for name in options.without}
    kept = tuple(node for node in nodes if node.name not in left_out)
    return Run(kept, options, tuple(arguments))


def _robot(text: str) -> str:
    robot_file(text)
    return text


def _parameter_file(text: str) -> Path:
    from head_tracking.parameter_files import read  # PyYAML takes 1 MB of the supervisor

    read(text)
    return Path(text)


def _target(text: str) -> tuple[tuple[NodeSpec, ...], str]:
    """Return the nodes that publish a target, and the scene for a simulated camera."""
    if text in TARGETS:
        return TARGETS[text], SCENES.get(text, "")
    try:
        point, frame_id = point_in_frame(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a target; give {', '.join(TARGETS)}, a frame such as @gripper_link, "
            "or a point in metres and its frame such as 1,0.5,0@base_link"
        ) from None
    if text.startswith("@"):
        return (NodeSpec("frame_target", ("buffer",), {"frame": frame_id}),), ""
    at_rest = {"frame_id": frame_id, "center": list(point), "amplitude": [0.0, 0.0, 0.0]}
    return (NodeSpec("fictitious_target", parameters=at_rest),), ""
