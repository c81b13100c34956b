"""Between the nodes' messages and the values of the core."""

from __future__ import annotations

from geometry_msgs.msg import PointStamped

from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns, vector
from head_tracking.tracking import Target


def target_from_message(message: PointStamped) -> Target:
    """Return the target of a message; a slash before its frame, as tf1 had it, is dropped."""
    frame_id = message.header.frame_id.removeprefix("/")
    return Target(stamp_to_ns(message.header.stamp), frame_id, vector(message.point))


def target_message(target: Target) -> PointStamped:
    """A target_point message."""
    message = PointStamped()
    message.header.stamp = ns_to_stamp(target.stamp)
    message.header.frame_id = target.frame_id
    message.point.x, message.point.y, message.point.z = target.point
    return message
