"""The control law of a servo: from the error to the drive of the motor.

Margin, slope and punch are the vendor's (e-manual page AX-12A, "compliance"), and so is the
proportional gain of other models, which is a slope without margin and punch. The formula and the
damping are ours, because the vendor publishes none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from head_tracking.dynamixel.models import ServoModel
from head_tracking.simulation.motion import TIME_CONSTANT

# Slope registers work in seven steps: the highest power of two not above the value.
_SLOPES: Final = (128, 64, 32, 16, 8, 4)

AX_DAMPING: Final = 0.17
"""Drive per rad/s: a damping ratio of 0.83 with the default slope (ours)."""

_DAMPING_RATIO: Final = 0.9  # of other models (ours)


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

    @classmethod
    def proportional(
        cls, model: ServoModel, slope: float, limit: float, punch: float = 0.0
    ) -> ComplianceLaw:
        """Return the law of a servo with a proportional gain.

        Args:
            model: The servo's model.
            slope: Error at full drive, rad; inf for a gain of 0.
            limit: Highest drive, 0 to 1.
            punch: Least drive, 0 to 1.
        """
        side = Side(0.0, slope)
        frequency = math.sqrt(model.no_load_speed / (TIME_CONSTANT * slope))
        wanted = 2.0 * _DAMPING_RATIO * frequency - 1.0 / TIME_CONSTANT  # the motor damps too
        damping = max(0.0, wanted * TIME_CONSTANT / model.no_load_speed)
        return cls(side, side, punch, limit, damping)
