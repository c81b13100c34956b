"""The cycle of a process that gets its joints from topics."""

from __future__ import annotations

from rclpy.node import Node
from sensor_msgs.msg import JointState

from head_tracking.control import ControlLoop
from head_tracking.tf import Buffer, TransformListener


def listen_for(loop: ControlLoop, buffer: Buffer, node: Node) -> TransformListener:
    """Feeds a buffer from what a node hears; joint states run the cycle unless something else does.

    Args:
        loop: of the process.
        buffer: of the same frames as the loop's.
        node: listens.
    """

    def on_joints(message: JointState) -> None:
        if not loop.driven:
            loop.update(message.name)
            loop.publish(message.name, 0, {})

    return TransformListener(buffer, node, on_joints=on_joints)
