"""Quality of service, lengths of names, and subscriptions of any reliability."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For rare changes, such as robot_description: a later subscriber receives the last one."""

EVERY_CHANGE = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For a subscription to such a topic that needs earlier messages, too."""

TF = QoSProfile(depth=100)
TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

MEASUREMENT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For a subscription to measurements of a publisher of any reliability."""

LONGEST_NAME = 255
"""Characters of a name in a message that are used: others may send texts of any length."""

LONGEST_TEXT = 500
"""Characters of a log message about a message of others."""

OVERRIDABLE = QoSOverridingOptions.with_default_policies()
"""Declares parameters such as `qos_overrides./servo_states.publisher.depth`."""


try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # ROS 2 Humble
    from rclpy.qos_event import SubscriptionEventCallbacks


class TopicListener:
    """A subscription that receives from publishers of any reliability.

    A BEST_EFFORT subscription receives from all, but loses the only message of a new publisher
    (one in five of `ros2 topic pub --once`). So this one is RELIABLE until a publisher offers less.
    """

    def __init__(
        self, node: Node, kind: type[Any], topic: str, callback: Callable[[Any], object]
    ) -> None:
        self._node = node
        self._arguments = kind, topic, callback
        events = SubscriptionEventCallbacks(incompatible_qos=lambda _: self._subscribe_again())
        self._subscription = node.create_subscription(
            *self._arguments, 10, event_callbacks=events, qos_overriding_options=OVERRIDABLE
        )

    def _subscribe_again(self) -> None:
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._node.create_subscription(*self._arguments, MEASUREMENT)
