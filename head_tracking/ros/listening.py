"""What a process hears: joints that run its cycle, and publishers that it cannot hear."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from head_tracking.control import ControlLoop
from head_tracking.tf import Buffer, TransformListener


def listen_for(loop: ControlLoop, buffer: Buffer, node: Node) -> TransformListener:
    """Feed a buffer from what a node hears; joint states run the cycle unless something else does.

    Args:
        loop: of the process.
        buffer: of the same frames as the loop's.
        node: listens.
    """
    return TransformListener(buffer, node, on_joints=lambda message: loop.heard(message.name))


def unheard(node: Node, kind: type[Any], topic: str, qos: QoSProfile) -> str:
    """Return which publishers a subscription cannot hear, and why; empty: it hears all.

    Args:
        node: listens.
        kind: of messages that it listens for.
        topic: its name.
        qos: of the subscription.
    """
    topic = node.resolve_topic_name(topic)
    accepted = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
    found = []
    for publisher in node.get_publishers_info_by_topic(topic):
        why = ""
        if publisher.topic_type != accepted:
            why = f"it publishes {publisher.topic_type}; {accepted} is accepted"
        else:
            verdict, reason = qos_check_compatible(publisher.qos_profile, qos)
            if verdict is QoSCompatibility.ERROR:
                why = reason
        if why:
            name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
            found.append(f"{name} is not heard on {topic}: {why}")
    return "; ".join(found)
