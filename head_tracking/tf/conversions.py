"""Between ROS messages and the values of the core."""

from __future__ import annotations

from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import Point, Quaternion, TransformStamped
from geometry_msgs.msg import Vector3 as Vector3Msg
from rclpy.time import Time

from head_tracking.transforms import Rotation, StampedTransform, Transform, Vector3

NANOSECONDS = 1_000_000_000


def stamp_to_ns(stamp: TimeMsg | Time) -> int:
    """Nanoseconds of a message's stamp or of an rclpy time."""
    if isinstance(stamp, Time):
        return int(stamp.nanoseconds)
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def ns_to_stamp(nanoseconds: int) -> TimeMsg:
    """A message's stamp from nanoseconds."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return TimeMsg(sec=seconds, nanosec=rest)


def vector(message: Point | Vector3Msg) -> Vector3:
    """The coordinates of a point or vector message."""
    return message.x, message.y, message.z


def transform_from_message(message: TransformStamped) -> Transform:
    """The core's transform, `T_frame_child`.

    Raises:
        InvalidArgumentException: the quaternion is not of unit length.
    """
    rotation = message.transform.rotation
    return Transform(
        vector(message.transform.translation),
        Rotation.from_quaternion_xyzw((rotation.x, rotation.y, rotation.z, rotation.w)),
    )


def transform_to_message(stamped: StampedTransform) -> TransformStamped:
    """A message with target_frame as header.frame_id and source_frame as child_frame_id."""
    message = TransformStamped()
    message.header.stamp = ns_to_stamp(stamped.stamp)
    message.header.frame_id = stamped.target_frame
    message.child_frame_id = stamped.source_frame
    x, y, z = stamped.transform.translation
    message.transform.translation = Vector3Msg(x=x, y=y, z=z)
    x, y, z, w = stamped.transform.rotation.quaternion_xyzw
    message.transform.rotation = Quaternion(x=x, y=y, z=z, w=w)
    return message
