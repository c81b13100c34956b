"""Where a servo means its shaft to be on the way to the goal.

X profiles: e-manual, "Profile Acceleration" and "Profile Velocity": step, rectangle, triangle or
trapezoid of velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Profile:
    """How fast a goal is approached.

    Attributes:
        velocity: Highest speed, rad/s; 0 is no limit.
        acceleration: rad/s^2; 0 is at once.
        duration: Time for the whole way, s; 0: `velocity` and `acceleration` hold instead.
        ramp: The part of `duration` in which speed rises, s.
    """

    velocity: float
    acceleration: float = 0.0
    duration: float = 0.0
    ramp: float = 0.0

    def over(self, distance: float) -> Profile:
        """Return the profile by velocity that takes the duration for a distance, rad."""
        if self.duration <= 0.0:
            return self
        ramp = min(self.ramp, self.duration / 2.0)
        velocity = abs(distance) / (self.duration - ramp)
        if self.velocity > 0.0:
            velocity = min(velocity, self.velocity)
        return Profile(velocity, velocity / ramp if ramp else 0.0)


class Setpoint:
    """Moves to the goal as the profile says; the compliance law holds the shaft to it.

    It never runs further ahead of the shaft than the law can use, so that a shaft that was blocked
    does not jump when it comes free.

    Attributes:
        angle: Where the shaft should be now, rad.
        speed: How fast it should move now, rad/s.
    """

    def __init__(self, angle: float) -> None:
        self.angle = angle
        self.speed = 0.0

    def follow(self, angle: float) -> None:
        """Rest at the shaft, while torque is off."""
        self.angle = angle
        self.speed = 0.0

    def approach(self, goal: float, profile: Profile, shaft: float, lead: float, dt: float) -> None:
        """Move on by one step.

        Args:
            goal: Goal angle, rad.
            profile: How fast.
            shaft: Angle of the shaft, rad.
            lead: How far the setpoint may be ahead of the shaft, rad.
            dt: Step, s.
        """
        if profile.velocity <= 0.0:
            self.follow(goal)
            return
        distance = goal - self.angle
        wanted = profile.velocity
        if profile.acceleration > 0.0:
            wanted = min(wanted, math.sqrt(2.0 * profile.acceleration * abs(distance)))
        self._accelerate(math.copysign(wanted, distance), profile.acceleration, dt)
        step = self.speed * dt
        if abs(distance) <= abs(step) and distance * step >= 0.0:
            self.follow(goal)
        else:
            self.angle += step
        self.angle = max(shaft - lead, min(shaft + lead, self.angle))

    def run(
        self, velocity: float, acceleration: float, shaft: float, lead: float, dt: float
    ) -> None:
        """Move on by one step at a speed, rad/s; the others are those of `approach`."""
        self._accelerate(velocity, acceleration, dt)
        self.angle += self.speed * dt
        self.angle = max(shaft - lead, min(shaft + lead, self.angle))

    def _accelerate(self, wanted: float, acceleration: float, dt: float) -> None:
        if acceleration <= 0.0:
            self.speed = wanted
        else:
            change = acceleration * dt
            self.speed = max(self.speed - change, min(self.speed + change, wanted))
