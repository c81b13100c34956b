"""Which nodes make up a run, and in which process each of them is: data, no decisions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import Any

from head_tracking.programs import node_class

CONTROL, VISION, PAGE = "control", "vision", "page"
"""The processes of a run: servos and head; cameras and detectors; the page in a browser."""


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node of a run.

    Attributes:
        name: the node's name.
        needs: arguments that its process hands to it: "buffer", the transforms that the nodes of
            the process share; "loop", its controllers; "connect", the port of simulated servos, or
            None; "true_position", where a simulated joint really is [rad], or None; "start", to
            start more nodes; "startable", their names.
        parameters: values that this run gives it, over those of the parameter files.
        process: where it runs.
    """

    name: str
    needs: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    process: str = CONTROL

    def make(self, shared: Mapping[str, Any]) -> Any:
        """Return the node.

        Args:
            shared: what its process can hand to it.
        """
        from rclpy.parameter import Parameter

        overrides = [Parameter(name, value=value) for name, value in self.parameters.items()]
        kind = resolve_name(node_class(self.name))
        return kind(parameter_overrides=overrides, **{name: shared[name] for name in self.needs})


ROBOT = (
    NodeSpec("servo_bus", ("connect", "loop")),
    NodeSpec("robot_state_publisher", ("buffer", "loop")),
    NodeSpec("joint_state_publisher", ("loop",)),
)

FEEDS_BUFFER = "robot_state_publisher"
"""The node that brings the process's buffer up to date."""

HEAD = "head"
"""Whatever node turns the head, as something to leave out."""

LEFT_OUT = (FEEDS_BUFFER, "joint_state_publisher", HEAD)
"""What a robot may have already, so that a run can do without."""

MODES: Mapping[str, NodeSpec] = {
    "track": NodeSpec("head_tracker", ("buffer", "loop")),
    "point": NodeSpec("point_head", ("buffer", "loop")),
}

# Driver and simulated servos share a process: on a busy machine an answer can be a while in coming.
SIMULATED_PORT: Mapping[str, Any] = {"reply_timeout": 0.1}


def _visual(follow: str) -> tuple[NodeSpec, ...]:
    return (NodeSpec("visual_target", ("buffer",), {"follow": follow}, VISION),)


def _fictitious(**parameters: Any) -> tuple[NodeSpec, ...]:
    return (NodeSpec("fictitious_target", parameters=parameters),)


TARGETS: Mapping[str, tuple[NodeSpec, ...]] = {
    "none": (),
    "fictitious": _fictitious(),
    "smooth": _fictitious(path="harmonic"),
    "mux": (NodeSpec("target_mux", ("buffer",)),),
    "face": _visual("face"),
    "ball": _visual("colour"),
    "marker": _visual("marker"),
    "features": _visual("features"),
    "nearest": _visual("nearest"),
    **{
        source: (NodeSpec("detection_target", ("buffer",), {"source": source}, VISION),)
        for source in ("detections_2d", "detections_3d", "faces", "bodies")
    },
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
    """Return the camera of a simulated head; small images, for they share a processor."""
    return NodeSpec(
        "simulated_camera",
        ("buffer", "true_position"),
        {"scene": scene, "width": 320, "height": 240, **parameters},
        VISION,
    )


STARTER = NodeSpec("node_starter", ("start", "startable"))
VIEWER = NodeSpec("viewer", process=PAGE)


def started_on_request(*, simulated: bool) -> Mapping[str, NodeSpec]:
    """Return what can be started on the page; with a camera if the head is simulated."""
    camera = simulated_camera("everything", rate=15.0)
    targets = (*TARGETS["fictitious"], *TARGETS["face"])
    specs = (*MODES.values(), *targets, *([camera] if simulated else []))
    return {spec.name: spec for spec in specs}


def frame_target(frame: str) -> tuple[NodeSpec, ...]:
    """Return the node that publishes where a frame is."""
    return (NodeSpec("frame_target", ("buffer",), {"frame": frame}),)


def fixed_target(point: tuple[float, float, float], frame_id: str) -> tuple[NodeSpec, ...]:
    """Return the nodes that keep publishing one point [m]: the fictitious target at rest."""
    return _fictitious(frame_id=frame_id, center=list(point), amplitude=[0.0, 0.0, 0.0])
