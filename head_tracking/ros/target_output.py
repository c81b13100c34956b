"""Targets for the controllers of this process, and for others."""

from __future__ import annotations

from geometry_msgs.msg import PointStamped
from rclpy.node import Node

from head_tracking.control import ControlLoop
from head_tracking.ros.messages import target_message
from head_tracking.tracking import Target


class TargetOutput:
    """`target_point`: handed over to the controllers of this process, published for others.

    If anybody outside of this process listens, all get it over the topic, and nobody gets it twice.

    Args:
        node: publishes.
        loop: the controllers of this process; None: there are none.
    """

    def __init__(self, node: Node, loop: ControlLoop | None) -> None:
        self.publisher = node.create_publisher(PointStamped, "target_point", 10)
        self._loop = loop

    def send(self, target: Target) -> None:
        """Lets everybody have a target."""
        takers = self._loop.target_takers if self._loop else []
        if takers and self.publisher.get_subscription_count() <= len(takers):
            for take in takers:
                take(target)
        else:
            self.publisher.publish(target_message(target))
