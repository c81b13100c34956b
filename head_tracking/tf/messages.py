"""Messages made and read quickly.

The constructors of ROS's message classes set every field several times over: a TransformStamped
takes longer than the lookup that it tells of. Here the fields are put where the classes keep
them; the tests compare the outcome with what the constructors make.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped
from geometry_msgs.msg import Transform as TransformMsg
from geometry_msgs.msg import Vector3 as Vector3Msg
from std_msgs.msg import Header

from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.transforms import StampedTransform, Transform, Vector3

_new = object.__new__
_SECOND = 1_000_000_000
Message = TypeVar("Message")


def stamped(kind: type[Message], stamp: int, frame_id: str, field: str, value: Any) -> Message:
    """A message of a header and one more field, `_field`."""
    result: Any = _new(kind)
    result._check_fields = False
    result._header = header(stamp, frame_id)
    setattr(result, field, value)
    message: Message = result
    return message


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


def xyz(kind: type[Message], numbers: Vector3) -> Message:
    """A Point or a Vector3."""
    result: Any = _new(kind)
    result._check_fields = False
    result._x, result._y, result._z = numbers
    message: Message = result
    return message


def quaternion(numbers: Sequence[float]) -> Quaternion:
    """A Quaternion of x, y, z, w."""
    result = _new(Quaternion)
    result._check_fields = False
    result._x, result._y, result._z, result._w = numbers
    return result


def pose(numbers: Transform) -> Pose:
    """A Pose of a transform's numbers."""
    result = _new(Pose)
    result._check_fields = False
    result._position = xyz(Point, numbers[:3])
    result._orientation = quaternion(numbers[3:])
    return result


def transform_stamped(found: StampedTransform) -> TransformStamped:
    """target_frame as header.frame_id, source_frame as child_frame_id."""
    stamp, target_frame, source_frame, (x, y, z, qx, qy, qz, qw) = found
    translation = _new(Vector3Msg)
    translation._check_fields = False
    translation._x, translation._y, translation._z = x, y, z
    rotation = _new(Quaternion)
    rotation._check_fields = False
    rotation._x, rotation._y, rotation._z, rotation._w = qx, qy, qz, qw
    transform = _new(TransformMsg)
    transform._check_fields = False
    transform._translation = translation
    transform._rotation = rotation
    result = _new(TransformStamped)
    result._check_fields = False
    result._header = header(stamp, target_frame)
    result._child_frame_id = source_frame
    result._transform = transform
    return result


def read(message: TransformStamped) -> tuple[int, str, str, Transform]:
    """Stamp [ns], parent, child and transform of a message, taken as they are."""
    at, numbers = message._header, message._transform
    p, q = numbers._translation, numbers._rotation
    transform = tuple.__new__(Transform, (p._x, p._y, p._z, q._x, q._y, q._z, q._w))
    return stamp_to_ns(at._stamp), at._frame_id, message._child_frame_id, transform
