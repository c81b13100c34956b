"""What is known of a target: where it was, how it moves, how sure that is, how old."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from head_tracking.transforms import Vector3

_LEAST_SWING = 1e-3  # rad/s


class Coordinate(NamedTuple):
    """How one coordinate moves: a part with constant acceleration and one that swings.

    Attributes:
        position: [m].
        velocity: of the steady part [m/s].
        acceleration: of the steady part [m/s^2].
        swing_velocity: of the swinging part [m/s].
        swing_acceleration: of the swinging part [m/s^2].
        rate: at which that part swings [rad/s].
    """

    position: float
    velocity: float
    acceleration: float = 0.0
    swing_velocity: float = 0.0
    swing_acceleration: float = 0.0
    rate: float = 0.0

    def after(self, dt: float) -> tuple[float, float]:
        """Position [m] and velocity [m/s] a time `dt` [s] later."""
        x, v, a, u, b, w = self
        w = max(w, _LEAST_SWING)
        sine, cosine = math.sin(w * dt), math.cos(w * dt)
        position = x + dt * (v + 0.5 * dt * a) + (u * sine + b * (1.0 - cosine) / w) / w
        return position, v + dt * a + u * cosine + b * sine / w


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """A target that moves on for a while as it last moved, and then comes to a stop.

    Attributes:
        stamp: time of the newest point [s].
        point: the newest point as it was measured, shape (3,) [m].
        motion: x, y and z at `stamp`, in the frame of the points.
        noise: standard deviation of the points along any axis [m].
        spread: variances and covariances of the estimate along any axis at `stamp`, of position,
            velocity and acceleration: pp, pv, pa, vv, va, aa [m, s].
        jerk: how fast the target may change its acceleration, as a spectral density [m^2/s^5].
        trust: the time [s] over which the motion is believed.
        timeout: the target is taken to have come to a stop so long [s] after `stamp`.
    """

    stamp: float
    point: Vector3
    motion: tuple[Coordinate, Coordinate, Coordinate]
    noise: float
    spread: tuple[float, float, float, float, float, float]
    jerk: float
    trust: float
    timeout: float

    def age(self, now: float) -> float:
        """How long ago the newest point was measured [s]."""
        return now - self.stamp

    def position(self, time: float) -> Vector3:
        """Where the target is [m] at a time [s], as far as can be told."""
        return self._moved(time)[0]

    def velocity(self, time: float) -> Vector3:
        """How the target moves [m/s] at a time [s], as far as can be told."""
        return self._moved(time)[1]

    def _moved(self, time: float) -> tuple[Vector3, Vector3]:
        ahead = time - self.stamp
        (x, u), (y, v), (z, w) = (axis.after(min(ahead, self.trust)) for axis in self.motion)
        if ahead <= self.trust:
            return (x, y, z), (u, v, w)
        fading = max(self.timeout - self.trust, 1e-3)
        beyond = min(ahead - self.trust, fading)
        way = beyond - 0.5 * beyond * beyond / fading  # the speed falls linearly to 0
        left = 1.0 - beyond / fading
        return (x + way * u, y + way * v, z + way * w), (left * u, left * v, left * w)

    def deviation(self, time: float) -> float:
        """Standard deviation of that position along any axis [m]."""
        h = abs(time - self.stamp)
        pp, pv, pa, vv, va, aa = self.spread
        spread = pp + h * (2.0 * pv + h * (vv + pa + h * (va + 0.25 * h * aa)))
        return math.sqrt(max(0.0, spread + self.jerk * h**5 / 20.0))

    @property
    def speed_deviation(self) -> float:
        """Standard deviation of the velocity at `stamp` along any axis [m/s]."""
        return math.sqrt(self.spread[3])
