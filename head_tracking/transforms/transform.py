"""Rotations, rigid transforms and velocities in floats, which are faster than small arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np
import numpy.typing as npt

Vector3 = tuple[float, float, float]
Matrix3 = npt.NDArray[np.float64]

UNIT_TOLERANCE = 1e-2
"""tf2's tolerance for the square of a quaternion's norm."""
_TINY = 1e-12
_ALIKE = 1.0 - 1e-15
"""The cosine of half an angle for which slerp equals linear interpolation."""


class Rotation(NamedTuple):
    """A unit quaternion (x, y, z, w), as in geometry_msgs; the constructor does not check it."""

    x: float
    y: float
    z: float
    w: float

    @staticmethod
    def identity() -> Rotation:
        """Return the identity."""
        return _NO_ROTATION

    @staticmethod
    def from_axis_angle(axis: Sequence[float], angle: float) -> Rotation:
        """Return the rotation by `angle` [rad] about the unit vector `axis`, shape (3,)."""
        half = 0.5 * angle
        s = math.sin(half)
        return Rotation(axis[0] * s, axis[1] * s, axis[2] * s, math.cos(half))

    @staticmethod
    def from_rpy(roll: float, pitch: float, yaw: float) -> Rotation:
        """Return the rotation of roll, pitch, yaw [rad] about fixed axes x, y, z, as in URDF."""
        sr, cr = math.sin(0.5 * roll), math.cos(0.5 * roll)
        sp, cp = math.sin(0.5 * pitch), math.cos(0.5 * pitch)
        sy, cy = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
        return Rotation(
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )

    @staticmethod
    def from_matrix(matrix: Matrix3) -> Rotation:
        """Return the rotation of an orthonormal matrix, shape (3, 3).

        Source: Bar-Itzhack, with the largest component, which is exact near 180 degrees.

        Raises:
            ValueError: the matrix has another shape, is not orthonormal, or mirrors.
        """
        m = np.asarray(matrix, dtype=float)
        is_rotation = m.shape == (3, 3) and np.allclose(m @ m.T, np.eye(3), atol=UNIT_TOLERANCE)
        if not is_rotation or np.linalg.det(m) < 0.0:
            raise ValueError(
                f"a rotation is an orthonormal matrix of shape (3, 3) that does not mirror; {m} is "
                "none"
            )
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = m.tolist()
        squares = (1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz)
        largest = max(range(4), key=squares.__getitem__)
        rows = (
            (squares[0], yx + xy, xz + zx, zy - yz),
            (yx + xy, squares[1], zy + yz, xz - zx),
            (xz + zx, zy + yz, squares[2], yx - xy),
            (zy - yz, xz - zx, yx - xy, squares[3]),
        )
        x, y, z, w = rows[largest]
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        return Rotation(x / norm, y / norm, z / norm, w / norm)

    def as_matrix(self) -> Matrix3:
        """Return the matrix, shape (3, 3)."""
        x, y, z, w = self
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    def as_rpy(self) -> Vector3:
        """Return roll, pitch, yaw [rad] as in URDF; at pitch +-90 degrees roll is 0."""
        x, y, z, w = self
        sin_pitch = 2 * (w * y - z * x)
        if abs(sin_pitch) > 1 - _TINY:
            # only yaw - roll (looking down) or yaw + roll (up) is defined
            return 0.0, math.copysign(math.pi / 2, sin_pitch), 2 * math.atan2(z, w)
        return (
            math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            math.asin(sin_pitch),
            math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        )

    def inverse(self) -> Rotation:
        """Return the inverse rotation."""
        return Rotation(-self.x, -self.y, -self.z, self.w)

    @overload
    def __matmul__(self, other: Rotation) -> Rotation: ...  # type: ignore[overload-overlap]
    @overload
    def __matmul__(self, other: Sequence[float]) -> Vector3: ...
    def __matmul__(self, other: Rotation | Sequence[float]) -> Rotation | Vector3:
        if isinstance(other, Rotation):
            ax, ay, az, aw = self
            bx, by, bz, bw = other
            return Rotation(
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            )
        return self.apply(other)

    def apply(self, vector: Sequence[float]) -> Vector3:
        """Rotate a vector, shape (3,)."""
        vx, vy, vz = vector
        x, y, z, w = self
        # t = 2 q x v;  v' = v + w t + q x t
        tx = 2 * (y * vz - z * vy)
        ty = 2 * (z * vx - x * vz)
        tz = 2 * (x * vy - y * vx)
        return (
            vx + w * tx + y * tz - z * ty,
            vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx,
        )


class Pose(NamedTuple):
    """A translation [m] and a unit quaternion."""

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
    ``p_target = T_target_source @ p_source``. It is a tuple of seven numbers.
    """

    __slots__ = ()

    def __new__(cls, translation: Sequence[float], rotation: Rotation) -> Transform:
        """Make a transform of a translation, shape (3,) [m], and a rotation."""
        x, y, z = translation
        return tuple.__new__(cls, (x, y, z, *rotation))

    def __repr__(self) -> str:
        return f"Transform({self.translation}, {self.rotation})"

    def __getnewargs__(self) -> tuple[Vector3, Rotation]:
        return self.translation, self.rotation

    @property
    def translation(self) -> Vector3:
        """The origin of the source frame in the target frame [m]."""
        return self[:3]

    @property
    def rotation(self) -> Rotation:
        """The orientation of the source frame in the target frame."""
        return Rotation(*self[3:])

    @staticmethod
    def identity() -> Transform:
        """Return the identity."""
        return _IDENTITY

    @staticmethod
    def from_xyz_rpy(
        xyz: Sequence[float] = (0.0, 0.0, 0.0), rpy: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Transform:
        """Return a transform from the `<origin>` of URDF: a translation [m] and rpy [rad]."""
        x, y, z = xyz
        return Transform((float(x), float(y), float(z)), Rotation.from_rpy(*rpy))

    @staticmethod
    def from_matrix(matrix: npt.NDArray[np.float64]) -> Transform:
        """Return the transform of a homogeneous matrix, shape (4, 4).

        Raises:
            ValueError: the matrix has another shape, or its rotation is none.
        """
        m = np.asarray(matrix, dtype=float)
        if m.shape != (4, 4):
            raise ValueError(f"a transform is a matrix of shape (4, 4), not {m.shape}")
        return Transform(m[:3, 3].tolist(), Rotation.from_matrix(m[:3, :3]))

    def as_matrix(self) -> npt.NDArray[np.float64]:
        """Return the homogeneous matrix, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation.as_matrix()
        matrix[:3, 3] = self[:3]
        return matrix

    def inverse(self) -> Transform:
        """Return the inverse transform."""
        x, y, z, i, j, k, w = self
        ux, uy, uz = 2.0 * (k * y - j * z), 2.0 * (i * z - k * x), 2.0 * (j * x - i * y)
        return tuple.__new__(
            Transform,
            (
                j * uz - k * uy - w * ux - x,
                k * ux - i * uz - w * uy - y,
                i * uy - j * ux - w * uz - z,
                -i,
                -j,
                -k,
                w,
            ),
        )

    @overload
    def __matmul__(self, other: Transform) -> Transform: ...  # type: ignore[overload-overlap]
    @overload
    def __matmul__(self, other: Sequence[float]) -> Vector3: ...
    def __matmul__(self, other: Transform | Sequence[float]) -> Transform | Vector3:
        if isinstance(other, Transform):
            return tuple.__new__(Transform, product(self, other))
        return self.apply(other)

    def apply(self, point: Sequence[float]) -> Vector3:
        """Transform a point, shape (3,) [m]."""
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
        """Transform points, shape (N, 3) [m]."""
        rotated = np.asarray(points, dtype=float) @ self.rotation.as_matrix().T
        return np.asarray(rotated + self[:3])

    def interpolate(self, other: Transform, ratio: float) -> Transform:
        """Interpolate to `other` by a ratio of 0 to 1: linear, and slerp."""
        ax, ay, az, ai, aj, ak, aw = self
        bx, by, bz, bi, bj, bk, bw = other
        a, b = 1.0 - ratio, ratio
        cosine = ai * bi + aj * bj + ak * bk + aw * bw
        if -_ALIKE < cosine < _ALIKE:
            angle = math.acos(abs(cosine))
            sine = math.sin(angle)
            a, b = math.sin(a * angle) / sine, math.sin(b * angle) / sine
        if cosine < 0.0:
            b = -b
        return tuple.__new__(
            Transform,
            (
                ax + ratio * (bx - ax),
                ay + ratio * (by - ay),
                az + ratio * (bz - az),
                a * ai + b * bi,
                a * aj + b * bj,
                a * ak + b * bk,
                a * aw + b * bw,
            ),
        )


def product(a: Sequence[float], b: Sequence[float]) -> tuple[float, ...]:
    """Return the numbers of `a @ b`, of two transforms given by their numbers."""
    ax, ay, az, i, j, k, w = a
    x, y, z, qx, qy, qz, qw = b
    # p' = t + p + w u + v x u with u = 2 v x p, where (v, w) is the quaternion of a
    ux, uy, uz = 2.0 * (j * z - k * y), 2.0 * (k * x - i * z), 2.0 * (i * y - j * x)
    return (
        ax + x + w * ux + j * uz - k * uy,
        ay + y + w * uy + k * ux - i * uz,
        az + z + w * uz + i * uy - j * ux,
        w * qx + i * qw + j * qz - k * qy,
        w * qy - i * qz + j * qw + k * qx,
        w * qz + i * qy - j * qx + k * qw,
        w * qw - i * qx - j * qy - k * qz,
    )


def signed_as_tf2(transform: Transform) -> Transform:
    """Return the transform with the sign of the quaternion as in tf2.

    tf2 converts through a matrix: w is positive for rotations below 120 degrees, else the largest
    of x, y, z. Source: Matrix3x3.getRotation of tf2's LinearMath.
    """
    x, y, z, i, j, k, w = transform
    if (w if abs(w) > 0.5 else max(i, j, k, key=abs)) > 0.0:
        return transform
    return tuple.__new__(Transform, (x, y, z, -i, -j, -k, -w))


class StampedTransform(NamedTuple):
    """The result of a lookup.

    Attributes:
        stamp: its time [ns]; 0 if the frames never move.
        target_frame: the target frame (header.frame_id of a message).
        source_frame: the source frame (child_frame_id of a message).
        transform: takes points from `source_frame` into `target_frame`.
    """

    stamp: int
    target_frame: str
    source_frame: str
    transform: Transform


_NO_ROTATION = Rotation(0.0, 0.0, 0.0, 1.0)
_IDENTITY = Transform((0.0, 0.0, 0.0), _NO_ROTATION)
