"""A Kalman filter of a moving point: constant acceleration, disturbed by white jerk.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation,
section 6.2 (the continuous white noise jerk model). The three axes share one covariance, in units
of the variance of a measurement, so that one number decides how the filter behaves: `agility`,
the spectral density of the jerk over that variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from head_tracking.transforms import Vector3

# What is known of a target seen once, in units of a measurement's standard deviation. Bearings
# of 2 mrad make this 2 rad/s and 2 rad/s^2: more would let the second point of a new target
# throw the head.
_UNKNOWN_SPEED = 1e6  # variance, 1/s^2
_UNKNOWN_ACCELERATION = 1e6  # variance, 1/s^4


class Motion(NamedTuple):
    """What a filter knows after a measurement.

    Attributes:
        position: [m].
        velocity: [m/s].
        acceleration: [m/s^2].
        covariance: of position, velocity and acceleration along any axis, in units of the
            variance of a measurement: pp, pv, pa, vv, va, aa.
    """

    position: Vector3
    velocity: Vector3
    acceleration: Vector3
    covariance: tuple[float, float, float, float, float, float]

    @staticmethod
    def seen_once(point: Vector3) -> Motion:
        """A target of which only one point is known."""
        nothing = (0.0, 0.0, 0.0)
        unknown = (1.0, 0.0, 0.0, _UNKNOWN_SPEED, 0.0, _UNKNOWN_ACCELERATION)
        return Motion(point, nothing, nothing, unknown)

    def position_after(self, dt: float) -> Vector3:
        """The position [m] a time `dt` [s] later, or earlier, at constant acceleration."""
        (x, y, z), (vx, vy, vz), (ax, ay, az) = self.position, self.velocity, self.acceleration
        half = 0.5 * dt * dt
        return x + dt * vx + half * ax, y + dt * vy + half * ay, z + dt * vz + half * az


def corrected(motion: Motion, dt: float, point: Vector3, agility: float) -> tuple[Motion, float]:
    """The motion after a measurement, and how well the measurement fitted.

    Args:
        motion: at the measurement before.
        dt: time since then [s], 0 or more.
        point: measured position [m].
        agility: how fast the target may change its acceleration [1/s^5].

    Returns:
        The motion at the measurement; and the squared distance from the predicted point over its
        expected variance, in units of the variance of a measurement [m^2].
    """
    pp, pv, pa, vv, va, aa = motion.covariance
    half = 0.5 * dt * dt
    # predicted covariance: F P F' + Q
    pv_ = pv + dt * vv + half * va
    pa_ = pa + dt * va + half * aa
    pp = pp + dt * pv + half * pa + dt * pv_ + half * pa_
    va_ = va + dt * aa
    pv = pv_ + dt * pa_
    vv = vv + dt * va + dt * va_
    pa, va = pa_, va_
    q = agility * dt
    q3, q4, q5 = q * dt * dt, q * dt**3, q * dt**4
    pp += q5 / 20.0
    pv += q4 / 8.0
    pa += q3 / 6.0
    vv += q3 / 3.0
    va += 0.5 * q * dt
    aa += q
    # correction
    expected = pp + 1.0
    kp, kv, ka = pp / expected, pv / expected, pa / expected
    px, py, pz = motion.position_after(dt)
    (vx, vy, vz), (ax, ay, az) = motion.velocity, motion.acceleration
    ix, iy, iz = point[0] - px, point[1] - py, point[2] - pz
    after = Motion(
        (px + kp * ix, py + kp * iy, pz + kp * iz),
        (vx + dt * ax + kv * ix, vy + dt * ay + kv * iy, vz + dt * az + kv * iz),
        (ax + ka * ix, ay + ka * iy, az + ka * iz),
        (pp - kp * pp, pv - kp * pv, pa - kp * pa, vv - kv * pv, va - kv * pa, aa - ka * pa),
    )
    return after, (ix * ix + iy * iy + iz * iz) / expected


def mixed(weights: Sequence[float], motions: Sequence[Motion]) -> Motion:
    """The mean of several motions; the weights sum to 1."""
    x = y = z = vx = vy = vz = ax = ay = az = 0.0
    pp = pv = pa = vv = va = aa = 0.0
    for w, ((px, py, pz), (ux, uy, uz), (bx, by, bz), c) in zip(weights, motions, strict=True):
        x, y, z = x + w * px, y + w * py, z + w * pz
        vx, vy, vz = vx + w * ux, vy + w * uy, vz + w * uz
        ax, ay, az = ax + w * bx, ay + w * by, az + w * bz
        pp, pv, pa = pp + w * c[0], pv + w * c[1], pa + w * c[2]
        vv, va, aa = vv + w * c[3], va + w * c[4], aa + w * c[5]
    return Motion((x, y, z), (vx, vy, vz), (ax, ay, az), (pp, pv, pa, vv, va, aa))
