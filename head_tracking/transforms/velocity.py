"""Velocities of frames, from where they were at two times."""

from __future__ import annotations

import math
from typing import NamedTuple

from head_tracking.transforms.rotation import Rotation, Vector3
from head_tracking.transforms.transform import Transform


class StampedVelocity(NamedTuple):
    """How a body moves.

    Attributes:
        stamp: the middle of the time that it was observed over [ns].
        reference_frame: the frame of the two vectors.
        body_frame: the frame that moves.
        linear: velocity of the reference point [m/s].
        angular: angular velocity [rad/s].
    """

    stamp: int
    reference_frame: str
    body_frame: str
    linear: Vector3
    angular: Vector3


def velocity_between(start: Transform, end: Transform, seconds: float) -> tuple[Vector3, Vector3]:
    """Mean velocity [m/s] and angular velocity [rad/s], in the frame that observes.

    Args:
        start: `T_observation_body` at the beginning.
        end: the same at the end.
        seconds: the time between.
    """
    a, b = start.translation, end.translation
    linear = tuple((there - here) / seconds for here, there in zip(a, b, strict=True))
    turn = end.rotation @ start.rotation.inverse()
    return (linear[0], linear[1], linear[2]), _rotation_vector(turn, seconds)


def moved_to(point: Vector3, linear: Vector3, angular: Vector3) -> Vector3:
    """The velocity of another point of a body, `point` [m] away from the one given."""
    x, y, z = point
    wx, wy, wz = angular
    vx, vy, vz = linear
    return vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x


def _rotation_vector(turn: Rotation, seconds: float) -> Vector3:
    x, y, z, w = turn if turn.w >= 0 else Rotation(-turn.x, -turn.y, -turn.z, -turn.w)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-12:
        return 2 * x / seconds, 2 * y / seconds, 2 * z / seconds
    rate = 2 * math.atan2(sine, w) / sine / seconds
    return rate * x, rate * y, rate * z
