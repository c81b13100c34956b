"""The topic `target_point`: its messages, and what a node offers that publishes it."""

from __future__ import annotations

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from head_tracking.ros.kit.threads import answering
from head_tracking.ros.kit.topics import LATCHED, LONGEST_NAME, OVERRIDABLE
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns
from head_tracking.tracking import Target


def target_from_message(message: PointStamped) -> Target:
    """Return the target of a message; a leading slash of its frame, as in tf1, is removed."""
    frame_id = message.header.frame_id[:LONGEST_NAME].removeprefix("/")
    point = message.point
    return Target(stamp_to_ns(message.header.stamp), frame_id, (point.x, point.y, point.z))


def target_message(target: Target) -> PointStamped:
    """Return the message of a target."""
    message = PointStamped()
    message.header.stamp = ns_to_stamp(target.stamp)
    message.header.frame_id = target.frame_id
    message.point.x, message.point.y, message.point.z = target.point
    return message


class TargetOutput:
    """Publishes `target_point` and `~/enabled`, and offers `~/enable`.

    Attributes:
        on: whether the node is enabled; it is at the start.
        topic: the full name of `target_point`.
    """

    def __init__(self, node: Node) -> None:
        self.on = True
        targets = node.create_publisher(
            PointStamped, "target_point", 10, qos_overriding_options=OVERRIDABLE
        )
        self.topic, self._publish = targets.topic_name, targets.publish
        self._publisher = node.create_publisher(Bool, "~/enabled", LATCHED)
        node.create_service(SetBool, "~/enable", answering(self._on_enable))
        self._publisher.publish(Bool(data=True))

    def publish(self, target: Target) -> None:
        """Publish a target if the node is enabled."""
        if self.on:
            self._publish(target_message(target))

    def set(self, on: bool) -> None:
        """Enable or disable the node."""
        self.on = on
        self._publisher.publish(Bool(data=on))

    def _on_enable(self, request: SetBool.Request) -> str:
        self.set(request.data)
        return "targets are published" if self.on else "no targets are published"
