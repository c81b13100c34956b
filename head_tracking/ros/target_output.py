"""Targets for whoever follows them."""

from __future__ import annotations

from geometry_msgs.msg import PointStamped
from rclpy.node import Node

from head_tracking.control import ControlLoop
from head_tracking.ros.messages import target_message
from head_tracking.tracking import Target


class TargetOutput:
    """Publishes `target_point`, unless the run of the process is held: another head would follow.

    Args:
        node: publishes.
        loop: of the process; None: there is none.
    """

    def __init__(self, node: Node, loop: ControlLoop | None) -> None:
        self.publisher = node.create_publisher(PointStamped, "target_point", 10)
        self._loop = loop

    def send(self, target: Target) -> None:
        """Publish a target."""
        if self._loop is None or not self._loop.held:
            self.publisher.publish(target_message(target))
