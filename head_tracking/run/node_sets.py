"""The nodes of a run, and the process of each: data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import Any

from head_tracking.detectors import DETECTORS
from head_tracking.programs import node_class

CONTROL, VISION, PAGE = "control", "vision", "page"
"""The processes of a run: servos and head; cameras and detectors; the page."""


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node of a run.

    Attributes:
        name: the node's name.
        needs: constructor arguments that its process provides: "buffer", the transforms of the
            process; "loop", the control loop; "simulate", which makes simulated servos, or None.
        parameters: values of this run; they override parameter files.
        defaults: of parameters, for a constructor argument of that name; empty: the node's own.
        process: CONTROL, VISION or PAGE.
        enabled: whether it publishes from the start, if its process is not CONTROL.
    """

    name: str
    needs: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    process: str = CONTROL
    enabled: bool = True
    defaults: Mapping[str, Any] = field(default_factory=dict)

    def make(self, available: Mapping[str, Any]) -> Any:
        """Make the node.

        Args:
            available: what its process provides, by the names in `needs`.
        """
        from rclpy.parameter import Parameter

        overrides = [Parameter(name, value=value) for name, value in self.parameters.items()]
        kind = resolve_name(node_class(self.name))
        options = {name: available[name] for name in self.needs}
        if self.defaults:
            options["defaults"] = self.defaults
        return kind(parameter_overrides=overrides, **options)


FEEDS_BUFFER = "robot_state_publisher"
"""The node that writes joint positions into the buffer of the process."""

HEAD = "head"
"""Stands for the controller of the head in `--without`."""

LEFT_OUT = (FEEDS_BUFFER, "joint_state_publisher", HEAD)
"""Nodes that a run can omit, because the robot has them already."""

MODES: Mapping[str, NodeSpec] = {
    "track": NodeSpec("head_tracker", ("loop",)),
    "point": NodeSpec("point_head", ("loop",)),
}


TARGETS: Mapping[str, tuple[NodeSpec, ...]] = {
    "none": (),
    "fictitious": (NodeSpec("fictitious_target"),),
    "smooth": (NodeSpec("fictitious_target", parameters={"path": "harmonic"}),),
    "mux": (NodeSpec("target_mux", ("buffer",)),),
    **{
        spec.target: (NodeSpec("visual_target", ("buffer",), {"follow": name}, VISION),)
        for name, spec in DETECTORS.items()
    },
    **{
        source: (NodeSpec("detection_target", ("buffer",), {"source": source}, VISION),)
        for source in ("detections_2d", "detections_3d", "faces", "bodies")
    },
}

SCENES: Mapping[str, str] = {spec.target: spec.scene for spec in DETECTORS.values()}
"""What the simulated camera draws for a target that is detected in images."""


def simulated_camera(scene: str, *, shown: bool) -> NodeSpec:
    """Return the camera of a simulated head, with small images unless a page shows them."""
    size = {} if shown else {"width": 320, "height": 240}
    defaults = {"scene": scene, **size}
    return NodeSpec("simulated_camera", ("buffer",), process=VISION, defaults=defaults)


VIEWER = NodeSpec("viewer", process=PAGE)

CAMERA = simulated_camera("everything", shown=True)
"""What the page shows of a simulated head whose target needs no camera."""


STARTED_ON_REQUEST = (*MODES.values(), *TARGETS["fictitious"], *TARGETS["face"])
"""The nodes that the page can start."""
