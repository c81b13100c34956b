"""Hearing publishers of any reliability, and naming those that cannot be heard."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from head_tracking.ros.kit.qos import MEASUREMENT, OVERRIDABLE

try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # ROS 2 Humble
    from rclpy.qos_event import SubscriptionEventCallbacks


class TopicListener:
    """Hears all publishers of a topic, those with BEST_EFFORT, too.

    A BEST_EFFORT subscription would hear all of them, but loses the only message of a publisher
    that has just begun (`ros2 topic pub --once`: every fifth). So it asks for RELIABLE until a
    publisher offers less.

    Args:
        node: listens.
        kind: of messages.
        topic: its name.
        callback: is given each message.
    """

    def __init__(
        self, node: Node, kind: type[Any], topic: str, callback: Callable[[Any], object]
    ) -> None:
        self._node = node
        self._what = kind, topic, callback
        events = SubscriptionEventCallbacks(incompatible_qos=lambda _: self._ask_for_less())
        self._subscription = node.create_subscription(
            *self._what, 10, event_callbacks=events, qos_overriding_options=OVERRIDABLE
        )

    def _ask_for_less(self) -> None:
        self.close()
        self._subscription = self._node.create_subscription(*self._what, MEASUREMENT)

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_subscription(self._subscription)


def unheard(node: Node, kind: type[Any], topic: str) -> str:
    """Return which publishers a `TopicListener` cannot hear, and why; empty: it hears all.

    Args:
        node: listens.
        kind: of messages that it listens for.
        topic: its name.
    """
    topic = node.resolve_topic_name(topic)
    accepted = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
    found = []
    for publisher in node.get_publishers_info_by_topic(topic):
        why = ""
        if publisher.topic_type != accepted:
            why = f"it publishes {publisher.topic_type}; {accepted} is accepted"
        else:
            verdict, reason = qos_check_compatible(publisher.qos_profile, MEASUREMENT)
            if verdict is QoSCompatibility.ERROR:
                why = reason
        if why:
            name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
            found.append(f"{name} is not heard on {topic}: {why}")
    return "; ".join(found)
