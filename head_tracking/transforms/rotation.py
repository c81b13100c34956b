"""Rotations as unit quaternions, in plain floats: numpy's call overhead would dominate here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np
import numpy.typing as npt

from head_tracking.transforms.exceptions import InvalidArgumentException

Vector3 = tuple[float, float, float]
Matrix3 = npt.NDArray[np.float64]

UNIT_TOLERANCE = 1e-2
"""tf2's tolerance for the square of a quaternion's norm."""
_TINY = 1e-12


class Rotation(NamedTuple):
    """A rotation in space: the unit quaternion (x, y, z, w), as in geometry_msgs.

    The constructor takes the components as they are; use :meth:`from_quaternion_xyzw` for
    numbers that come from outside.

    (A named tuple, because it is made three times faster than a frozen dataclass.)
    """

    x: float
    y: float
    z: float
    w: float

    @staticmethod
    def identity() -> Rotation:
        """The rotation that changes nothing."""
        return _IDENTITY

    @staticmethod
    def from_quaternion_xyzw(quaternion_xyzw: Sequence[float]) -> Rotation:
        """A rotation from a quaternion of shape (4,), normalised.

        Raises:
            InvalidArgumentException: not four finite numbers, or the square of the norm is not 1
                within tf2's tolerance of 0.01.
        """
        if len(quaternion_xyzw) != 4 or not all(map(math.isfinite, quaternion_xyzw)):
            raise InvalidArgumentException(
                f"a quaternion needs four finite numbers x, y, z, w; got {quaternion_xyzw!r}"
            )
        x, y, z, w = map(float, quaternion_xyzw)
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if abs(norm * norm - 1.0) > UNIT_TOLERANCE:
            raise InvalidArgumentException(
                f"the quaternion ({x}, {y}, {z}, {w}) has the norm {norm:.9g}; normalise it to 1"
            )
        return Rotation(x / norm, y / norm, z / norm, w / norm)

    @staticmethod
    def from_axis_angle(axis: Sequence[float], angle: float) -> Rotation:
        """A rotation by `angle` [rad] about the unit vector `axis`, shape (3,), right-handed."""
        half = 0.5 * angle
        s = math.sin(half)
        return Rotation(axis[0] * s, axis[1] * s, axis[2] * s, math.cos(half))

    @staticmethod
    def from_rpy(roll: float, pitch: float, yaw: float) -> Rotation:
        """A rotation from URDF's roll, pitch, yaw [rad]: about the fixed axes x, then y, then z."""
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
        """A rotation from a proper orthonormal matrix, shape (3, 3).

        Source: Bar-Itzhack's choice of the largest component, which stays exact near 180 degrees.
        """
        m = np.asarray(matrix, dtype=float)
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
        """The same rotation as a matrix, shape (3, 3)."""
        x, y, z, w = self
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    def as_rpy(self) -> Vector3:
        """Roll, pitch, yaw [rad] about the fixed axes x, y, z; at pitch +-90 degrees roll is 0."""
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

    def angle(self) -> float:
        """The angle of the rotation [rad], 0 to pi."""
        vector = math.sqrt(self.x * self.x + self.y * self.y + self.z * self.z)
        return 2 * math.atan2(vector, abs(self.w))

    def inverse(self) -> Rotation:
        """The rotation back."""
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
        """The vector, shape (3,), turned."""
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

    def slerp(self, other: Rotation, ratio: float) -> Rotation:
        """The rotation `ratio` (0 to 1) of the way to `other`, at constant speed, the short way."""
        x, y, z, w = other
        cosine = self.x * x + self.y * y + self.z * z + self.w * w
        if cosine < 0:
            cosine, x, y, z, w = -cosine, -x, -y, -z, -w
        if cosine > 1 - 1e-9:
            a, b = 1 - ratio, ratio
        else:
            theta = math.acos(cosine)
            sine = math.sin(theta)
            a, b = math.sin((1 - ratio) * theta) / sine, math.sin(ratio * theta) / sine
        x, y, z, w = (
            a * self.x + b * x,
            a * self.y + b * y,
            a * self.z + b * z,
            a * self.w + b * w,
        )
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        return Rotation(x / norm, y / norm, z / norm, w / norm)


_IDENTITY = Rotation(0.0, 0.0, 0.0, 1.0)
