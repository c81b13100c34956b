"""Rigid transforms between frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np
import numpy.typing as npt

from head_tracking.transforms.rotation import Rotation, Vector3


class Pose(NamedTuple):
    """The seven numbers of a rigid transform: a translation [m] and a unit quaternion."""

    x: float
    y: float
    z: float
    qx: float
    qy: float
    qz: float
    qw: float


class Transform(Pose):
    """A rigid transform: rotate, then translate [m].

    `T_target_source` takes points given in `source` into `target`:
    ``p_target = T_target_source @ p_source``.

    (A tuple of its seven numbers, because lookups make one each.)
    """

    __slots__ = ()

    def __new__(cls, translation: Sequence[float], rotation: Rotation) -> Transform:
        """A transform from a translation, shape (3,) [m], and a rotation."""
        x, y, z = translation
        return tuple.__new__(cls, (x, y, z, *rotation))

    def __repr__(self) -> str:
        return f"Transform({self.translation}, {self.rotation})"

    def __getnewargs__(self) -> tuple[Vector3, Rotation]:
        return self.translation, self.rotation

    @property
    def translation(self) -> Vector3:
        """Where the source frame's origin is in the target frame [m]."""
        return self[:3]

    @property
    def rotation(self) -> Rotation:
        """How the source frame is turned in the target frame."""
        return Rotation(*self[3:])

    @staticmethod
    def identity() -> Transform:
        """The transform that changes nothing."""
        return _IDENTITY

    @staticmethod
    def from_xyz_rpy(
        xyz: Sequence[float] = (0.0, 0.0, 0.0), rpy: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Transform:
        """From URDF's origin: a translation [m] and fixed-axis roll, pitch, yaw [rad]."""
        x, y, z = xyz
        return Transform((float(x), float(y), float(z)), Rotation.from_rpy(*rpy))

    @staticmethod
    def from_matrix(matrix: npt.NDArray[np.float64]) -> Transform:
        """From a homogeneous matrix of a rigid motion, shape (4, 4)."""
        m = np.asarray(matrix, dtype=float)
        return Transform(m[:3, 3].tolist(), Rotation.from_matrix(m[:3, :3]))

    def as_matrix(self) -> npt.NDArray[np.float64]:
        """The same transform as a homogeneous matrix, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation.as_matrix()
        matrix[:3, 3] = self[:3]
        return matrix

    def inverse(self) -> Transform:
        """The transform the other way."""
        rotation = self.rotation.inverse()
        x, y, z = rotation.apply(self[:3])
        return Transform((-x, -y, -z), rotation)

    @overload
    def __matmul__(self, other: Transform) -> Transform: ...  # type: ignore[overload-overlap]
    @overload
    def __matmul__(self, other: Sequence[float]) -> Vector3: ...
    def __matmul__(self, other: Transform | Sequence[float]) -> Transform | Vector3:
        if isinstance(other, Transform):
            return Transform(self.apply(other[:3]), self.rotation @ other.rotation)
        return self.apply(other)

    def apply(self, point: Sequence[float]) -> Vector3:
        """The point, shape (3,) [m], in the target frame."""
        px, py, pz = point
        x, y, z, qx, qy, qz, qw = self
        # t = 2 q x p;  p' = p + w t + q x t
        tx = 2 * (qy * pz - qz * py)
        ty = 2 * (qz * px - qx * pz)
        tz = 2 * (qx * py - qy * px)
        return (
            px + qw * tx + qy * tz - qz * ty + x,
            py + qw * ty + qz * tx - qx * tz + y,
            pz + qw * tz + qx * ty - qy * tx + z,
        )

    def apply_many(self, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Many points at once, shape (N, 3) [m], in the target frame, shape (N, 3)."""
        rotated = np.asarray(points, dtype=float) @ self.rotation.as_matrix().T
        return np.asarray(rotated + self[:3])

    def interpolate(self, other: Transform, ratio: float) -> Transform:
        """The transform `ratio` (0 to 1) of the way to `other`: linear, and slerp."""
        ax, ay, az = self[:3]
        bx, by, bz = other[:3]
        return Transform(
            (ax + ratio * (bx - ax), ay + ratio * (by - ay), az + ratio * (bz - az)),
            self.rotation.slerp(other.rotation, ratio),
        )


class StampedTransform(NamedTuple):
    """The answer to a lookup: `T_target_source` and the time for which it holds.

    Attributes:
        stamp: nanoseconds; 0 where nothing on the way ever changes.
        target_frame: the frame that points are taken into (a message's header.frame_id).
        source_frame: the frame that points are taken from (a message's child_frame_id).
        transform: takes points from `source_frame` into `target_frame`.
    """

    stamp: int
    target_frame: str
    source_frame: str
    transform: Transform


_IDENTITY = Transform((0.0, 0.0, 0.0), Rotation.identity())
