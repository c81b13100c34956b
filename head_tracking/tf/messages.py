"""Fast construction of messages.

The constructors of ROS message classes set each field several times: a TransformStamped takes
longer than the lookup of its values. These functions set the slots of the classes; tests compare
the results with those of the constructors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped
from geometry_msgs.msg import Transform as TransformMsg
from geometry_msgs.msg import Vector3 as Vector3Msg
from std_msgs.msg import Header

from head_tracking.tf.conversions import NANOSECONDS, stamp_to_ns
from head_tracking.transforms import StampedTransform, Transform, Vector3

try:
    from tf2_msgs import msg, srv

    TFMessage, FrameGraph = msg.TFMessage, srv.FrameGraph
except ImportError:  # it is not among the ROS wheels
    TFMessage = FrameGraph = None

_new = object.__new__
Message = TypeVar("Message")


def stamped(kind: type[Message], found: StampedTransform, field: str, value: Any) -> Message:
    """Return a message of a header, with stamp and target frame of a lookup, and one more field."""
    result: Any = _new(kind)
    result._check_fields = False
    result._header = header(found.stamp, found.target_frame)
    setattr(result, field, value)
    message: Message = result
    return message


def header(stamp: int, frame_id: str) -> Header:
    """Return a header; the stamp is in nanoseconds."""
    time = _new(Time)
    time._check_fields = False
    time._sec, time._nanosec = divmod(stamp, NANOSECONDS)
    result = _new(Header)
    result._check_fields = False
    result._stamp = time
    result._frame_id = frame_id
    return result


def xyz(kind: type[Message], numbers: Vector3) -> Message:
    """Return a Point or a Vector3."""
    result: Any = _new(kind)
    result._check_fields = False
    result._x, result._y, result._z = numbers
    message: Message = result
    return message


def quaternion(numbers: Sequence[float]) -> Quaternion:
    """Return a Quaternion of x, y, z, w."""
    result = _new(Quaternion)
    result._check_fields = False
    result._x, result._y, result._z, result._w = numbers
    return result


def pose(numbers: Transform) -> Pose:
    """Return a Pose."""
    result = _new(Pose)
    result._check_fields = False
    result._position = xyz(Point, numbers[:3])
    result._orientation = quaternion(numbers[3:])
    return result


def transform_stamped(found: StampedTransform) -> TransformStamped:
    """Return the message of a lookup: its target frame is header.frame_id."""
    stamp, target_frame, source_frame, numbers = found
    transform = _new(TransformMsg)
    transform._check_fields = False
    transform._translation = xyz(Vector3Msg, numbers[:3])
    transform._rotation = quaternion(numbers[3:])
    result = _new(TransformStamped)
    result._check_fields = False
    result._header = header(stamp, target_frame)
    result._child_frame_id = source_frame
    result._transform = transform
    return result


def read(message: TransformStamped) -> tuple[int, str, str, Transform]:
    """Return stamp [ns], parent, child and transform of a message, not checked."""
    at, numbers = message._header, message._transform
    p, q = numbers._translation, numbers._rotation
    transform = tuple.__new__(Transform, (p._x, p._y, p._z, q._x, q._y, q._z, q._w))
    return stamp_to_ns(at._stamp), at._frame_id, message._child_frame_id, transform
