"""Diagnostics that say whose they are: /diagnostics is one topic for all robots."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node


def in_namespace(node: Node, message: DiagnosticArray) -> DiagnosticArray:
    """The message, with the node's namespace before the names in it.

    As diagnostic_updater has it with `use_fqn`: `left/servo_bus: head_pan_joint`.
    """
    namespace = node.get_namespace().strip("/")
    if namespace:
        for status in message.status:
            status.name = f"{namespace}/{status.name}"
    return message
