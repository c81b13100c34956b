"""Transforming messages: the functions of tf2_geometry_msgs and tf2_sensor_msgs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    Polygon,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    QuaternionStamped,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from geometry_msgs.msg import (
    Transform as TransformMsg,
)
from sensor_msgs.msg import PointCloud2, PointField

from head_tracking.tf import conversions
from head_tracking.tf.conversions import rotation, stamp_to_ns, transform, vector
from head_tracking.tf.messages import header, pose, quaternion, stamped, transform_stamped, xyz
from head_tracking.tf.registration import (
    ConvertRegistration,
    DoTransform,
    TransformRegistration,
    TypeException,
)
from head_tracking.transforms import Rotation, StampedTransform, Transform

Maker: TypeAlias = Callable[[Any, StampedTransform], Any]
"""Transforms a message by the result of a lookup."""

MAKERS: dict[DoTransform, Maker] = {}
"""The same functions for lookups of this process, without a TransformStamped in between."""


def to_msg_msg(msg: Any) -> Any:
    """Return the message itself."""
    return msg


from_msg_msg = to_msg_msg


def transform_covariance(cov_in: npt.ArrayLike, transform: TransformStamped) -> npt.NDArray[Any]:
    """Rotate a covariance of position and orientation, 36 numbers."""
    return _rotated_covariance(cov_in, rotation(transform.transform.rotation))


def transform_points(
    point_cloud: npt.ArrayLike, transform: TransformMsg | TransformStamped
) -> npt.NDArray[np.float64]:
    """Transform points, shape (N, 3) [m]."""
    message = transform.transform if isinstance(transform, TransformStamped) else transform
    return conversions.transform(message).apply_many(point_cloud)


def do_transform_pose(pose: Pose, transform_stamped: TransformStamped) -> Pose:
    """Transform a pose that has no header."""
    return _moved(pose, transform(transform_stamped.transform))


def _point(message: PointStamped, found: StampedTransform) -> PointStamped:
    moved = found.transform.apply(vector(message.point))
    return stamped(PointStamped, found, "_point", xyz(Point, moved))


def _vector(message: Vector3Stamped, found: StampedTransform) -> Vector3Stamped:
    rotated = found.transform.rotation.apply(vector(message.vector))
    return stamped(Vector3Stamped, found, "_vector", xyz(Vector3, rotated))


def _quaternion(message: QuaternionStamped, found: StampedTransform) -> QuaternionStamped:
    rotated = found.transform.rotation @ rotation(message.quaternion)
    return stamped(QuaternionStamped, found, "_quaternion", quaternion(rotated))


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


def _polygon(message: PolygonStamped, found: StampedTransform) -> PolygonStamped:
    moved = [found.transform.apply(vector(corner)) for corner in message.polygon.points]
    value = Polygon(points=[Point32(x=x, y=y, z=z) for x, y, z in moved])
    return stamped(PolygonStamped, found, "_polygon", value)


def _transform(message: TransformStamped, found: StampedTransform) -> TransformStamped:
    moved = found.transform @ transform(message.transform)
    return transform_stamped(
        StampedTransform(found.stamp, found.target_frame, message.child_frame_id, moved)
    )


def _cloud(message: PointCloud2, found: StampedTransform) -> PointCloud2:
    """Transform x, y and z of each point and keep its other fields."""
    data = bytearray(message.data)
    columns = _coordinates(message, data)
    points = np.stack([columns[name].ravel().astype(float) for name in "xyz"], axis=1)
    moved = found.transform.apply_many(points)
    for name, column in zip("xyz", moved.T, strict=True):
        columns[name] = column.reshape(columns.shape)
    return PointCloud2(
        header=header(found.stamp, found.target_frame),
        height=message.height,
        width=message.width,
        fields=message.fields,
        is_bigendian=message.is_bigendian,
        point_step=message.point_step,
        row_step=message.row_step,
        data=bytes(data),
        is_dense=message.is_dense,
    )


def _coordinates(cloud: PointCloud2, data: bytearray) -> npt.NDArray[Any]:
    """Return a view of x, y, z in the data of a cloud, shape (height, width)."""
    floats = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}
    order = ">" if cloud.is_bigendian else "<"
    fields = {field.name: field for field in cloud.fields if field.name in ("x", "y", "z")}
    if len(fields) < 3 or any(field.datatype not in floats for field in fields.values()):
        raise TypeException("a PointCloud2 needs the fields x, y and z as FLOAT32 or FLOAT64")
    try:
        layout = np.dtype(
            {
                "names": ["x", "y", "z"],
                "formats": [order + floats[fields[name].datatype] for name in "xyz"],
                "offsets": [fields[name].offset for name in "xyz"],
                "itemsize": cloud.point_step,
            }
        )
        strides = (cloud.row_step or cloud.width * cloud.point_step, cloud.point_step)
        return np.ndarray((cloud.height, cloud.width), layout, data, 0, strides)
    except (TypeError, ValueError) as error:
        raise TypeException(
            f"a PointCloud2 of {cloud.height} x {cloud.width} points of {cloud.point_step} bytes "
            f"does not fit its {len(data)} bytes of data: {error}"
        ) from error


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
    ConvertRegistration().add_to_msg(kind, to_msg_msg)
    ConvertRegistration().add_from_msg(kind, from_msg_msg)
    return do_transform


do_transform_point = _registered(PointStamped, _point)
do_transform_vector3 = _registered(Vector3Stamped, _vector)
do_transform_pose_stamped = _registered(PoseStamped, _pose)
do_transform_pose_with_covariance_stamped = _registered(
    PoseWithCovarianceStamped, _pose_with_covariance
)
do_transform_polygon_stamped = _registered(PolygonStamped, _polygon)
do_transform_cloud = _registered(PointCloud2, _cloud)
do_transform_quaternion_stamped = _registered(QuaternionStamped, _quaternion)
do_transform_transform_stamped = _registered(TransformStamped, _transform)
