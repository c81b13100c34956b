"""Messages made and read quickly.

The constructors of ROS's message classes set every field several times over: a TransformStamped
takes longer than the lookup that it tells of. Here the fields are put where the classes keep
them; the tests compare the outcome with what the constructors make.
"""

from __future__ import annotations

from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point,
    PointStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from std_msgs.msg import Header

from head_tracking.transforms import StampedTransform

_new = object.__new__
_SECOND = 1_000_000_000


def header(stamp: int, frame_id: str) -> Header:
    """A header with a stamp given in nanoseconds."""
    time = _new(Time)
    time._check_fields = False
    time._sec, time._nanosec = divmod(stamp, _SECOND)
    result = _new(Header)
    result._check_fields = False
    result._stamp = time
    result._frame_id = frame_id
    return result


def transform_stamped(stamped: StampedTransform) -> TransformStamped:
    """target_frame as header.frame_id, source_frame as child_frame_id."""
    stamp, target_frame, source_frame, (x, y, z, qx, qy, qz, qw) = stamped
    translation = _new(Vector3)
    translation._check_fields = False
    translation._x, translation._y, translation._z = x, y, z
    rotation = _new(Quaternion)
    rotation._check_fields = False
    rotation._x, rotation._y, rotation._z, rotation._w = qx, qy, qz, qw
    transform = _new(Transform)
    transform._check_fields = False
    transform._translation = translation
    transform._rotation = rotation
    result = _new(TransformStamped)
    result._check_fields = False
    result._header = header(stamp, target_frame)
    result._child_frame_id = source_frame
    result._transform = transform
    return result


def point_stamped(frame_id: str, located: tuple[int, float, float, float]) -> PointStamped:
    """A point in a frame: its time [ns], and x, y, z [m]."""
    point = _new(Point)
    point._check_fields = False
    stamp, point._x, point._y, point._z = located
    result = _new(PointStamped)
    result._check_fields = False
    result._header = header(stamp, frame_id)
    result._point = point
    return result


def point_of(message: PointStamped) -> tuple[int, str, tuple[float, float, float]]:
    """The time [ns], the frame and the coordinates [m] of a point."""
    at, point = message._header, message._point
    time = at._stamp
    return time._sec * _SECOND + time._nanosec, at._frame_id, (point._x, point._y, point._z)
