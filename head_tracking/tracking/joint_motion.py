"""The motion a joint is meant to make: on its way to what is wanted, inside its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.transforms import JointLimits

_RESPONSE = 25.0  # 1/s: how fast a deviation from what is wanted is made up
_BRAKING = 0.6  # share of the acceleration used to plan where to brake
_LEAST_BRAKING = 0.05
_NEED_TIME = 0.3  # s
_COPIED = 0.4  # of the acceleration: with less to spare than this a motion is copied in part


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """How a joint may move.

    Attributes:
        speed: [rad/s].
        acceleration: [rad/s^2].
        jerk: [rad/s^3].
    """

    speed: float
    acceleration: float
    jerk: float


class JointMotion:
    """Follows a wanted position that itself moves, without lag, and comes to jumps smoothly.

    A wanted motion that the limits allow is copied; a jump in it is made up as by a critically
    damped spring, and a long way at a speed from which the joint can brake in time.

    Args:
        position: where the joint stands [rad].
        velocity: how it moves [rad/s].

    Attributes:
        position: where the joint is meant to be [rad].
        velocity: how it is meant to move [rad/s].
    """

    def __init__(self, position: float, velocity: float = 0.0) -> None:
        self.position = position
        self.velocity = velocity
        self._acceleration = 0.0
        self._wanted_velocity = velocity
        self._asked_velocity = velocity
        self._need = 0.0

    def advance(self, dt: float) -> None:
        """Time passes [s]."""
        self.position += self.velocity * dt

    def rest_at(self, position: float) -> None:
        """The joint stands still [rad]."""
        self.position = position
        self.velocity = self._acceleration = self._wanted_velocity = self._asked_velocity = 0.0

    def steer(
        self, wanted: float, velocity: float, dt: float, limits: MotionLimits, joint: JointLimits
    ) -> None:
        """Chooses the velocity for the next `dt` [s].

        Args:
            wanted: where the joint should be now [rad].
            velocity: how it should move in the time `dt` [rad/s].
            dt: until the next choice [s].
            limits: how the joint may move.
            joint: its range, which is never left.
        """
        remaining = math.exp(-_RESPONSE * dt)
        # gains that put both poles of the sampled loop at `remaining`
        stiffness = (1.0 - remaining) ** 2 / (dt * dt)
        damping = (3.0 - 2.0 * remaining - remaining**2) / (2.0 * dt)
        error = wanted - self.position
        share = min(1.0, dt / _NEED_TIME)
        self._need += share * (abs(velocity - self._asked_velocity) / dt - self._need)
        self._asked_velocity = velocity
        # what the joint cannot follow it does not copy: it goes where the target is, as it can
        copied = min(max((1.0 - self._need / limits.acceleration) / _COPIED, 0.0), 1.0)
        closing = self._closing_speed(error, stiffness / damping, copied * self._need, limits)
        velocity *= copied
        needed = (velocity - self._wanted_velocity) / dt
        asked = needed
        asked += damping * (closing + self._wanted_velocity - self.velocity)
        self._wanted_velocity = velocity
        change = limits.jerk * dt
        acceleration = min(max(asked, self._acceleration - change), self._acceleration + change)
        acceleration = min(max(acceleration, -limits.acceleration), limits.acceleration)
        chosen = self.velocity + acceleration * dt
        fastest = max(limits.speed, abs(self.velocity) - limits.acceleration * dt)
        chosen = min(max(chosen, -fastest), fastest)
        chosen = self._inside(chosen, dt, limits, joint)
        self._acceleration = (chosen - self.velocity) / dt
        self.velocity = chosen

    def _closing_speed(self, error: float, gain: float, need: float, limits: MotionLimits) -> float:
        """The speed at which to make up an error: proportional, but one that can be braked."""
        spare = limits.acceleration - min(need, limits.acceleration)
        braking = max(_BRAKING * spare, _LEAST_BRAKING * limits.acceleration)
        linear = braking / gain**2  # where the two meet with the same slope
        if abs(error) <= linear:
            return gain * error
        return math.copysign(math.sqrt(braking * (2.0 * abs(error) - linear)), error)

    def _inside(
        self, velocity: float, dt: float, limits: MotionLimits, joint: JointLimits
    ) -> float:
        """The velocity, reduced so that the joint stops at the end of its range."""
        room = joint.upper - self.position if velocity > 0.0 else self.position - joint.lower
        if not math.isfinite(room):
            return velocity
        room = max(0.0, room)
        a = _BRAKING * limits.acceleration
        fastest = a * (math.sqrt(dt * dt + 2.0 * room / a) - dt)
        return min(max(velocity, -fastest), fastest)
