"""The messages that a buffer can take into another frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    Point,
    PointStamped,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)

from head_tracking.tf.conversions import rotation, transform, vector
from head_tracking.tf.messages import header, point_stamped, transform_stamped
from head_tracking.transforms import StampedTransform, Transform


class TypeException(Exception):
    """A message that cannot be transformed; tf2_ros's name."""


def transformed(message: Any, found: StampedTransform) -> Any:
    """The message in the frame and at the time of a lookup's answer.

    Raises:
        TypeException: nobody knows how to transform such a message; lists those that can be.
    """
    try:
        make = _MAKERS[type(message)]
    except KeyError:
        known = ", ".join(kind.__name__ for kind in _MAKERS)
        raise TypeException(
            f"a {type(message).__name__} cannot be transformed; possible are {known}"
        ) from None
    return make(message, found)


def _point(message: PointStamped, found: StampedTransform) -> PointStamped:
    moved = found.transform @ vector(message.point)
    return point_stamped(found.target_frame, (found.stamp, *moved))


def _vector(message: Vector3Stamped, found: StampedTransform) -> Vector3Stamped:
    x, y, z = found.transform.rotation @ vector(message.vector)
    return Vector3Stamped(header=_header(found), vector=Vector3(x=x, y=y, z=z))


def _quaternion(message: QuaternionStamped, found: StampedTransform) -> QuaternionStamped:
    x, y, z, w = found.transform.rotation @ rotation(message.quaternion)
    return QuaternionStamped(header=_header(found), quaternion=Quaternion(x=x, y=y, z=z, w=w))


def _pose(message: PoseStamped, found: StampedTransform) -> PoseStamped:
    return PoseStamped(header=_header(found), pose=_moved(message.pose, found.transform))


def _pose_with_covariance(
    message: PoseWithCovarianceStamped, found: StampedTransform
) -> PoseWithCovarianceStamped:
    turn = np.kron(np.eye(2), found.transform.rotation.as_matrix())
    covariance = turn @ np.reshape(message.pose.covariance, (6, 6)) @ turn.T
    return PoseWithCovarianceStamped(
        header=_header(found),
        pose=PoseWithCovariance(
            pose=_moved(message.pose.pose, found.transform), covariance=covariance.ravel()
        ),
    )


def _transform(message: TransformStamped, found: StampedTransform) -> TransformStamped:
    moved = found.transform @ transform(message)
    return transform_stamped(
        StampedTransform(found.stamp, found.target_frame, message.child_frame_id, moved)
    )


def _moved(pose: Pose, by: Transform) -> Pose:
    x, y, z, qx, qy, qz, qw = by @ Transform(vector(pose.position), rotation(pose.orientation))
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def _header(found: StampedTransform) -> Any:
    return header(found.stamp, found.target_frame)


_MAKERS: dict[type, Callable[[Any, StampedTransform], Any]] = {
    PointStamped: _point,
    Vector3Stamped: _vector,
    PoseStamped: _pose,
    PoseWithCovarianceStamped: _pose_with_covariance,
    QuaternionStamped: _quaternion,
    TransformStamped: _transform,
}
