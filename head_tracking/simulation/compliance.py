"""The control law of an AX servo: from goal and registers to the drive of the motor.

Margin, slope and punch are the vendor's (e-manual page AX-12A, "compliance"); the formula, the
damping and the way a moving speed is kept are ours, because the vendor publishes none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

# Slope registers work in seven steps: the highest power of two not above the value.
_SLOPES: Final = (128, 64, 32, 16, 8, 4)


def slope_ticks(register: int) -> int:
    """Return the proportional band, in ticks, of a Compliance Slope register."""
    return next((slope for slope in _SLOPES if register >= slope), 2)


@dataclass(frozen=True, slots=True)
class Side:
    """One side of the goal.

    Attributes:
        margin: Error without drive, rad.
        slope: Further error up to full drive, rad.
    """

    margin: float
    slope: float


@dataclass(frozen=True, slots=True)
class ComplianceLaw:
    """Drive as a function of error and speed.

    Attributes:
        clockwise: Side used when the shaft must turn clockwise (falling angle).
        counterclockwise: Side used when it must turn counter-clockwise.
        punch: Drive at the edge of the margin, 0 to 1.
        limit: Highest drive, 0 to 1.
        damping: Drive taken away per rad/s of speed error.
    """

    clockwise: Side
    counterclockwise: Side
    punch: float
    limit: float
    damping: float

    def drive(self, error: float, speed_error: float) -> float:
        """Return the drive, -1 to 1, counter-clockwise positive.

        Args:
            error: Setpoint minus angle, rad.
            speed_error: Speed minus the setpoint's speed, rad/s.
        """
        side = self.counterclockwise if error > 0.0 else self.clockwise
        excess = abs(error) - side.margin
        if excess <= 0.0:
            return 0.0
        drive = self.punch + excess / side.slope * (1.0 - self.punch)
        if error < 0.0:
            drive = -drive
        return max(-self.limit, min(self.limit, drive - self.damping * speed_error))


class Setpoint:
    """Moves to the goal at the moving speed; the compliance law holds the shaft to it.

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

    def advance(
        self, goal: float, moving_speed: float, shaft: float, lead: float, dt: float
    ) -> None:
        """Move on by one step.

        Args:
            goal: Goal angle, rad.
            moving_speed: Speed limit, rad/s; 0 is none.
            shaft: Angle of the shaft, rad.
            lead: How far the setpoint may be ahead of the shaft, rad.
            dt: Step, s.
        """
        if moving_speed <= 0.0:
            self.angle = goal
            self.speed = 0.0
            return
        step = moving_speed * dt
        distance = goal - self.angle
        if abs(distance) <= step:
            self.angle = goal
            self.speed = 0.0
        else:
            self.speed = moving_speed if distance > 0.0 else -moving_speed
            self.angle += self.speed * dt
        self.angle = max(shaft - lead, min(shaft + lead, self.angle))
