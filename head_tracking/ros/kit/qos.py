"""How topics are delivered."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""robot_description, and what changes seldom: whoever comes later gets the last one."""

EVERY_CHANGE = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For listening to such a topic when what was said before the last one counts, too."""

TF = QoSProfile(depth=100)
TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

MEASUREMENT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For listening to measurements, whatever their sender promises."""

OVERRIDABLE = QoSOverridingOptions.with_default_policies()
"""Lets parameters such as `qos_overrides./servo_states.publisher.depth` change the delivery."""
