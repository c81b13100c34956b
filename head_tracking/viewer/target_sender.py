"""Sends targets for the page: once, or again and again."""

from __future__ import annotations

from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node

from head_tracking.transforms import Vector3

_PERIOD = 0.05  # s


class TargetSender:
    """Publishes `target_point`; may be used from any thread."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(PointStamped, "target_point", 10)
        self._kept: PointStamped | None = None
        self._timer = node.create_timer(_PERIOD, self._send_kept)
        self._timer.cancel()

    def send_once(self, frame: str, point: Vector3) -> None:
        """Sends a target that is meant for now [m]."""
        self.stop()
        self._publisher.publish(_message(frame, point))

    def keep_sending(self, frame: str, point: Vector3) -> None:
        """Sends a target [m] until another one is wanted."""
        self._kept = _message(frame, point)
        self._timer.reset()

    def stop(self) -> None:
        """Sends no more."""
        self._kept = None
        self._timer.cancel()

    def _send_kept(self) -> None:
        kept = self._kept
        if kept is not None:
            self._publisher.publish(kept)


def _message(frame: str, point: Vector3) -> PointStamped:
    x, y, z = map(float, point)
    message = PointStamped(point=Point(x=x, y=y, z=z))
    message.header.frame_id = frame
    return message
