"""point_head: turns the head to a point and says whether it got there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from head_tracking.control import ControlLoop
from head_tracking.gaze import PointingParameters
from head_tracking.head.modes import LookingOnce
from head_tracking.parameters import parameter
from head_tracking.ros.head.head_actions import HeadActions
from head_tracking.ros.head.head_interface import HeadInterface
from head_tracking.ros.kit.closing_node import ClosingNode
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.tf import Buffer

_PERIOD = 0.02  # s


@dataclass(frozen=True, slots=True)
class PointHeadParameters:
    """What to point."""

    pointing_frame: str = parameter("camera_link", "The frame to point.", fixed=True)
    controller_name: str = parameter(
        "",
        "Below this name clients find the actions and joint_trajectory: head_controller for those "
        "of TIAGo, head_traj_controller for PR2's. Empty: below the node's own.",
        fixed=True,
    )


class PointHeadNode(ClosingNode):
    """Points a frame of the head at `target_point`, or as the goals of actions have it.

    As long as a goal is under way, points on `target_point` are left alone.

    Args:
        buffer: the transforms that the process shares; None: this node listens itself.
        loop: that of the process; None: this node runs it.
    """

    def __init__(
        self, buffer: Buffer | None = None, loop: ControlLoop | None = None, **options: Any
    ) -> None:
        super().__init__("point_head", **options)
        p = NodeParameters(self, PointHeadParameters).value
        pointing = NodeParameters(self, PointingParameters)
        self.interface = HeadInterface(
            self,
            p.pointing_frame,
            "~/pointing_error",
            buffer,
            loop,
            LookingOnce(lambda: pointing.value),
            _PERIOD,
        )
        self.closing.callback(self.interface.close)
        self.actions = HeadActions(
            self, p.controller_name or "~", self.interface.control, lambda: pointing.value
        )
        self.interface.begin()

    @property
    def failure(self) -> Exception | None:
        """What has ended its part in the loop."""
        return self.interface.control.failure
