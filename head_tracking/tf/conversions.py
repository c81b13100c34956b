"""Between ROS messages and the values of the core."""

from __future__ import annotations

from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import Point, Quaternion, TransformStamped
from geometry_msgs.msg import Vector3 as Vector3Msg
from rclpy.duration import Duration
from rclpy.time import Time

from head_tracking.transforms import Rotation, Transform, Vector3

NANOSECONDS = 1_000_000_000


def stamp_to_ns(stamp: TimeMsg | Time) -> int:
    """Nanoseconds of a message's stamp or of an rclpy time.

    Raises:
        TypeError: it is neither.
    """
    if isinstance(stamp, TimeMsg):
        return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
    if isinstance(stamp, Time):
        return int(stamp.nanoseconds)
    raise TypeError(f"a time is rclpy's Time or a message's stamp; this is {stamp!r}")


def ns_to_stamp(nanoseconds: int) -> TimeMsg:
    """A message's stamp from nanoseconds."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return TimeMsg(sec=seconds, nanosec=rest)


def seconds(duration: Duration | None) -> float:
    """Seconds of a duration; none at all for None."""
    return 0.0 if duration is None else float(duration.nanoseconds) / NANOSECONDS


def vector(message: Point | Vector3Msg) -> Vector3:
    """The coordinates of a point or vector message, as floats whatever somebody put in."""
    return float(message.x), float(message.y), float(message.z)


def rotation(message: Quaternion) -> Rotation:
    """The rotation of a quaternion message, as floats whatever somebody put in."""
    return Rotation(float(message.x), float(message.y), float(message.z), float(message.w))


def transform(message: TransformStamped) -> Transform:
    """The core's transform, `T_frame_child`, taken as it is."""
    numbers = message.transform
    return Transform(vector(numbers.translation), rotation(numbers.rotation))
