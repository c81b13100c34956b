"""Transforming messages: tf2_ros's registration, and the functions of tf2_geometry_msgs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import (
    Point,
    PointStamped,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)

from head_tracking.tf.conversions import rotation, stamp_to_ns, transform, vector
from head_tracking.tf.messages import pose, stamped, xyz
from head_tracking.transforms import Rotation, StampedTransform, Transform

DoTransform: TypeAlias = Callable[[Any, TransformStamped], Any]

Maker: TypeAlias = Callable[[Any, StampedTransform], Any]
"""Transforms a message by the result of a lookup."""

MAKERS: dict[DoTransform, Maker] = {}
"""The same functions for lookups of this process, without a TransformStamped in between."""


class TypeException(Exception):
    """A message cannot be transformed."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class TransformRegistration:
    """The function that transforms each type of message; one table for the whole program."""

    _callbacks: dict[type, DoTransform] = {}  # noqa: RUF012 it is shared, as tf2's is

    def add(self, key: type, callback: DoTransform) -> None:
        """Transform messages of this type by `callback(message, transform_stamped)`."""
        self._callbacks[key] = callback

    def get(self, key: type) -> DoTransform:
        """Return the function for messages of this type.

        Raises:
            TypeException: none is registered.
        """
        if key not in self._callbacks:
            known = ", ".join(kind.__name__ for kind in self._callbacks)
            raise TypeException(
                f"a {key.__name__} cannot be transformed; types that can be: {known}"
            )
        return self._callbacks[key]


def do_transform_pose(pose: Pose, transform_stamped: TransformStamped) -> Pose:
    """Transform a pose that has no header."""
    return _moved(pose, transform(transform_stamped.transform))


def _point(message: PointStamped, found: StampedTransform) -> PointStamped:
    moved = found.transform.apply(vector(message.point))
    return stamped(PointStamped, found, "_point", xyz(Point, moved))


def _vector(message: Vector3Stamped, found: StampedTransform) -> Vector3Stamped:
    rotated = found.transform.rotation.apply(vector(message.vector))
    return stamped(Vector3Stamped, found, "_vector", xyz(Vector3, rotated))


def _pose(message: PoseStamped, found: StampedTransform) -> PoseStamped:
    return stamped(PoseStamped, found, "_pose", _moved(message.pose, found.transform))


def _pose_with_covariance(
    message: PoseWithCovarianceStamped, found: StampedTransform
) -> PoseWithCovarianceStamped:
    value = PoseWithCovariance(
        pose=_moved(message.pose.pose, found.transform),
        covariance=_rotated_covariance(message.pose.covariance, found.transform.rotation),
    )
    return stamped(PoseWithCovarianceStamped, found, "_pose", value)


def _moved(message: Pose, by: Transform) -> Pose:
    """Transform a pose; of the two quaternions return the one with w >= 0, as tf2 does."""
    x, y, z, i, j, k, w = by @ Transform(vector(message.position), rotation(message.orientation))
    sign = -1.0 if w < 0.0 else 1.0
    return pose(Transform((x, y, z), Rotation(sign * i, sign * j, sign * k, sign * w)))


def _rotated_covariance(covariance: npt.ArrayLike, by: Rotation) -> npt.NDArray[Any]:
    both = np.kron(np.eye(2), by.as_matrix())
    return np.asarray((both @ np.reshape(covariance, (6, 6)) @ both.T).ravel())


def _registered(kind: type, make: Maker) -> DoTransform:
    """Return and register the function for messages of a type."""

    def do_transform(message: Any, transform_stamped: TransformStamped) -> Any:
        at, child = transform_stamped.header, transform_stamped.child_frame_id
        numbers = transform(transform_stamped.transform)
        return make(message, StampedTransform(stamp_to_ns(at.stamp), at.frame_id, child, numbers))

    do_transform.__doc__ = f"Transform a {kind.__name__} to the target frame of a transform."
    MAKERS[do_transform] = make
    TransformRegistration().add(kind, do_transform)
    return do_transform


do_transform_point = _registered(PointStamped, _point)
do_transform_vector3 = _registered(Vector3Stamped, _vector)
do_transform_pose_stamped = _registered(PoseStamped, _pose)
do_transform_pose_with_covariance_stamped = _registered(
    PoseWithCovarianceStamped, _pose_with_covariance
)
