"""Quality of service of topics."""

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

OVERRIDABLE = QoSOverridingOptions.with_default_policies()
"""Declares parameters such as `qos_overrides./servo_states.publisher.depth`."""
