"""The cycle of a process that gets its joints from topics."""

from __future__ import annotations

from rclpy.node import Node

from head_tracking.control import ControlLoop
from head_tracking.tf import Buffer, TransformListener


def listen_for(loop: ControlLoop, buffer: Buffer, node: Node) -> TransformListener:
    """Feeds a buffer from what a node hears; joint states run the cycle unless something else does.

    Args:
        loop: of the process.
        buffer: of the same frames as the loop's.
        node: listens.
    """
    return TransformListener(buffer, node, on_joints=lambda message: loop.heard(message.name))
