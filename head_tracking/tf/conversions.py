"""Conversions between ROS messages and the values of `head_tracking.transforms`."""

from __future__ import annotations

from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import Point, Quaternion
from geometry_msgs.msg import Transform as TransformMsg
from geometry_msgs.msg import Vector3 as Vector3Msg
from rclpy.duration import Duration
from rclpy.time import Time

from head_tracking.transforms import Rotation, Transform, Vector3

NANOSECONDS = 1_000_000_000


def stamp_to_ns(stamp: TimeMsg | Time) -> int:
    """Return the nanoseconds of a message's stamp or of an rclpy time.

    Raises:
        TypeError: it is neither.
    """
    if isinstance(stamp, TimeMsg):
        return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
    if isinstance(stamp, Time):
        return int(stamp.nanoseconds)
    raise TypeError(f"{stamp!r} is neither an rclpy Time nor the stamp of a message")


def ns_to_stamp(nanoseconds: int) -> TimeMsg:
    """Return the stamp of a message."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return TimeMsg(sec=seconds, nanosec=rest)


def seconds(duration: Duration | None) -> float:
    """Return the seconds of a duration; 0 for None."""
    return 0.0 if duration is None else float(duration.nanoseconds) / NANOSECONDS


def vector(message: Point | Vector3Msg) -> Vector3:
    """Return the coordinates as floats, whatever numbers the fields hold."""
    return float(message.x), float(message.y), float(message.z)


def rotation(message: Quaternion) -> Rotation:
    """Return the rotation with floats, whatever numbers the fields hold."""
    return Rotation(float(message.x), float(message.y), float(message.z), float(message.w))


def transform(message: TransformMsg) -> Transform:
    """Return the transform, not normalised."""
    return Transform(vector(message.translation), rotation(message.rotation))
