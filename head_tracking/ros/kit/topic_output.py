"""A publisher that says nothing where nobody listens."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile


class Output:
    """A topic for others.

    Args:
        node: publishes.
        kind: of the messages.
        topic: its name.
        qos: as rclpy takes it.
        own: how many subscriptions this process has on it, for what others may say there.
    """

    def __init__(
        self, node: Node, kind: type, topic: str, qos: QoSProfile | int = 10, own: int = 0
    ) -> None:
        publisher = node.create_publisher(kind, topic, qos)
        self.publish: Callable[[Any], object] = publisher.publish
        self._listeners: Callable[[], int] = publisher.get_subscription_count
        self._own = own

    @property
    def wanted(self) -> bool:
        """Whether anybody outside of this process listens."""
        return self._listeners() > self._own
