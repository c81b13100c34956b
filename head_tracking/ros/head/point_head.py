"""point_head: turns the head to points, and reports whether it has arrived."""

from __future__ import annotations

from typing import Any

from head_tracking.configuration.head_nodes import PointHeadParameters
from head_tracking.control import ControlLoop
from head_tracking.gaze import PointingParameters
from head_tracking.head.motions import Pointing
from head_tracking.ros.head.head_actions import HeadActions
from head_tracking.ros.head.head_node import HeadNode
from head_tracking.ros.kit.node_parameters import NodeParameters

_PERIOD = 0.02  # s


class PointHeadNode(HeadNode):
    """Points a frame of the head at `target_point`, or executes the goals of its actions.

    While a goal is in progress, `target_point` is ignored.

    Args:
        loop: the control loop of the process; None: this node listens itself, and runs its own.
    """

    def __init__(self, loop: ControlLoop | None = None, **options: Any) -> None:
        super().__init__("point_head", **options)
        p = NodeParameters(self, PointHeadParameters).value
        pointing = NodeParameters(self, PointingParameters)
        self.create_control("~/pointing_error", loop, Pointing(lambda: pointing.value), _PERIOD)
        name = p.controller_name or "~"
        self.actions = HeadActions(self, name, self.control, lambda: pointing.value)
