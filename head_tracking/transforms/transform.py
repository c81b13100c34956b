"""Rigid transforms between frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
import numpy.typing as npt

from head_tracking.transforms.rotation import Rotation, Vector3


@dataclass(frozen=True, slots=True)
class Transform:
    """A rigid transform: rotate, then translate [m].

    `T_target_source` takes points given in `source` into `target`:
    ``p_target = T_target_source @ p_source``.
    """

    translation: Vector3
    rotation: Rotation

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
        x, y, z = m[:3, 3].tolist()
        return Transform((x, y, z), Rotation.from_matrix(m[:3, :3]))

    def as_matrix(self) -> npt.NDArray[np.float64]:
        """The same transform as a homogeneous matrix, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation.as_matrix()
        matrix[:3, 3] = self.translation
        return matrix

    def inverse(self) -> Transform:
        """The transform the other way."""
        rotation = self.rotation.inverse()
        x, y, z = rotation.apply(self.translation)
        return Transform((-x, -y, -z), rotation)

    @overload
    def __matmul__(self, other: Transform) -> Transform: ...
    @overload
    def __matmul__(self, other: Sequence[float]) -> Vector3: ...
    def __matmul__(self, other: Transform | Sequence[float]) -> Transform | Vector3:
        if isinstance(other, Transform):
            return Transform(self.apply(other.translation), self.rotation @ other.rotation)
        return self.apply(other)

    def apply(self, point: Sequence[float]) -> Vector3:
        """The point, shape (3,) [m], in the target frame."""
        x, y, z = self.rotation.apply(point)
        tx, ty, tz = self.translation
        return x + tx, y + ty, z + tz

    def interpolate(self, other: Transform, ratio: float) -> Transform:
        """The transform `ratio` (0 to 1) of the way to `other`: linear, and slerp."""
        ax, ay, az = self.translation
        bx, by, bz = other.translation
        return Transform(
            (ax + ratio * (bx - ax), ay + ratio * (by - ay), az + ratio * (bz - az)),
            self.rotation.slerp(other.rotation, ratio),
        )


@dataclass(frozen=True, slots=True)
class StampedTransform:
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
