"""What is known of a target: where it was, how it moves, how sure that is, how old."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.tracking.motion_filter import Motion
from head_tracking.transforms import Vector3


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """A target that moves on for a while as it last moved, and then comes to a stop.

    Attributes:
        stamp: time of the newest point [s].
        point: the newest point as it was measured, shape (3,) [m].
        motion: at `stamp`, in the frame of the points.
        variance: of the points along any axis [m^2].
        agility: how fast the target may change its acceleration [1/s^5]; see `motion_filter`.
        trust: the time [s] over which the acceleration is believed.
        timeout: the target is taken to have come to a stop so long [s] after `stamp`.
    """

    stamp: float
    point: Vector3
    motion: Motion
    variance: float
    agility: float
    trust: float
    timeout: float

    def age(self, now: float) -> float:
        """How long ago the newest point was measured [s]."""
        return now - self.stamp

    def position(self, time: float) -> Vector3:
        """Where the target is [m] at a time [s], as far as can be told."""
        ahead = time - self.stamp
        if ahead <= self.trust:
            return self.motion.position_after(ahead)
        fading = max(self.timeout - self.trust, 1e-3)
        beyond = min(ahead - self.trust, fading)
        way = beyond - 0.5 * beyond * beyond / fading  # the speed falls linearly to 0
        x, y, z = self.motion.position_after(self.trust)
        (vx, vy, vz), (ax, ay, az) = self.motion.velocity, self.motion.acceleration
        t = self.trust
        return x + way * (vx + t * ax), y + way * (vy + t * ay), z + way * (vz + t * az)

    def deviation(self, time: float) -> float:
        """Standard deviation of that position along any axis [m]."""
        h = abs(time - self.stamp)
        pp, pv, pa, vv, va, aa = self.motion.covariance
        spread = pp + h * (2.0 * pv + h * (vv + pa + h * (va + 0.25 * h * aa)))
        return math.sqrt(self.variance * (spread + self.agility * h**5 / 20.0))

    def speed_deviation(self) -> float:
        """Standard deviation of the velocity at `stamp` along any axis [m/s]."""
        return math.sqrt(self.variance * self.motion.covariance[3])
