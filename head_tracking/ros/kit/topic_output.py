"""A publisher that says nothing where nobody listens."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from head_tracking.ros.kit.qos import OVERRIDABLE


class Output:
    """A topic for others.

    Args:
        node: publishes.
        kind: of the messages.
        topic: its name.
        qos: its depth; see `OVERRIDABLE`.
        own: how many subscriptions this process has on it, for what others may say there.
    """

    def __init__(self, node: Node, kind: type, topic: str, qos: int = 10, own: int = 0) -> None:
        publisher = node.create_publisher(kind, topic, qos, qos_overriding_options=OVERRIDABLE)
        self.publish: Callable[[Any], object] = publisher.publish
        self._listeners: Callable[[], int] = publisher.get_subscription_count
        self._own = own

    @property
    def wanted(self) -> bool:
        """Whether anybody outside of this process listens."""
        return self._listeners() > self._own
