"""A node that keeps its publishers and subscriptions at hand, for messages that ROS wheels lack."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from rclpy.clock import ROSClock
from rclpy.logging import get_logger


class FakePublisher:
    def __init__(self) -> None:
        self.sent: list[Any] = []

    def publish(self, message: Any) -> None:
        self.sent.append(message)


class Topics:
    """What a listener or a broadcaster wants of a node."""

    def __init__(self) -> None:
        self.publishers: dict[str, FakePublisher] = {}
        self.callbacks: dict[str, Callable[[Any], None]] = {}

    def get_logger(self) -> Any:
        return get_logger("topics")

    def get_clock(self) -> ROSClock:
        return ROSClock()

    def create_publisher(self, kind: type, topic: str, qos: Any) -> FakePublisher:
        return self.publishers.setdefault(topic, FakePublisher())

    def create_subscription(
        self, kind: type, topic: str, callback: Callable[[Any], None], qos: Any, **_: Any
    ) -> str:
        self.callbacks[topic] = callback
        return topic

    def destroy_subscription(self, topic: str) -> None:
        del self.callbacks[topic]


class FakeTFMessage(SimpleNamespace):
    """tf2_msgs/TFMessage: transforms."""
