"""Which nodes make up a run: data, no decisions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import Any

from rclpy.node import Node


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node of a run.

    Attributes:
        name: the node's name.
        kind: its class, in head_tracking; imported when it is needed.
        takes: what the run hands to it: "buffer", the transforms that the process shares;
            "loop", its controllers; "connect", the port of simulated servos, or None;
            "true_position", where a simulated joint really is [rad], or None; "start", to start
            more nodes; "startable", their names; "simulated", whether the servos are;
            "arguments", ROS's own; "stop", who asks to stop.
        parameters: values that this run gives it, over those of the parameter files.
    """

    name: str
    kind: str
    takes: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def make(self) -> Callable[..., Node]:
        """Its class."""
        kind: Callable[..., Node] = resolve_name(f"head_tracking.{self.kind}")
        return kind


ROBOT = (
    NodeSpec("servo_bus", "nodes.servo_bus.ServoBusNode", takes=("connect", "loop")),
    NodeSpec(
        "robot_state_publisher",
        "nodes.robot_state_publisher.RobotStatePublisherNode",
        takes=("buffer", "loop"),
    ),
    NodeSpec(
        "joint_state_publisher",
        "nodes.joint_state_publisher.JointStatePublisherNode",
        takes=("loop",),
    ),
)

FEEDS_BUFFER = "robot_state_publisher"
"""The node that brings the process's buffer up to date."""

HEAD = "head"
"""Whatever node turns the head, as something to leave out."""

LEFT_OUT = (FEEDS_BUFFER, "joint_state_publisher", HEAD)
"""What a robot may have already, so that a run can do without."""


BUS_PROCESS = NodeSpec(
    "servo_bus", "nodes.bus_process.BusProcessNode", takes=("simulated", "arguments", "stop")
)
"""In the place of servo_bus: it runs in a process of its own."""

MODES: Mapping[str, NodeSpec] = {
    "track": NodeSpec(
        "head_tracker", "nodes.head_tracker.HeadTrackerNode", takes=("buffer", "loop")
    ),
    "point": NodeSpec("point_head", "nodes.point_head.PointHeadNode", takes=("buffer", "loop")),
}

# Driver and simulated servos share a process: on a busy machine an answer can be a while in coming.
SIMULATED_PORT: Mapping[str, Any] = {"reply_timeout": 0.1}


def _visual(follow: str, **parameters: Any) -> tuple[NodeSpec, ...]:
    given = {"follow": follow, **parameters}
    return (
        NodeSpec(
            "visual_target", "nodes.visual_target.VisualTargetNode", ("buffer", "loop"), given
        ),
    )


def _fictitious(**parameters: Any) -> tuple[NodeSpec, ...]:
    kind = "nodes.fictitious_target.FictitiousTargetNode"
    return (NodeSpec("fictitious_target", kind, ("loop",), parameters),)


TARGETS: Mapping[str, tuple[NodeSpec, ...]] = {
    "none": (),
    "fictitious": _fictitious(),
    "smooth": _fictitious(path="harmonic"),
    "mux": (NodeSpec("target_mux", "nodes.target_mux.TargetMuxNode", ("buffer", "loop")),),
    "face": _visual("face"),
    "ball": _visual("colour"),
    "marker": _visual("marker"),
    "features": _visual("features"),
    "nearest": _visual("nearest"),
}

SCENES: Mapping[str, str] = {
    "face": "faces",
    "ball": "ball",
    "marker": "marker",
    "features": "picture",
    "nearest": "ball",
}
"""What a simulated camera sees if a target is looked for in images."""


def simulated_camera(scene: str, **parameters: Any) -> NodeSpec:
    """The camera of a simulated head; small images, for it shares a processor with all the rest."""
    return NodeSpec(
        "simulated_camera",
        "nodes.simulated_camera.SimulatedCameraNode",
        takes=("buffer", "true_position"),
        parameters={"scene": scene, "width": 320, "height": 240, **parameters},
    )


STARTER = NodeSpec(
    "node_starter", "run.node_starter.NodeStarterNode", takes=("start", "startable", "loop")
)


def started_on_request(*, simulated: bool) -> Mapping[str, NodeSpec]:
    """What a person can start on the viewer's page; with a camera if the head is simulated."""
    camera = simulated_camera("everything", rate=15.0)
    targets = (*TARGETS["fictitious"], *TARGETS["face"])
    specs = (*MODES.values(), *targets, *([camera] if simulated else []))
    return {spec.name: spec for spec in specs}


def fixed_target(point: tuple[float, float, float], frame_id: str) -> tuple[NodeSpec, ...]:
    """The nodes that keep publishing one point [m]: the fictitious target without a swing."""
    return _fictitious(frame_id=frame_id, center=list(point), amplitude=[0.0, 0.0, 0.0])
