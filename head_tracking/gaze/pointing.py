"""Commands for a head, how it turns to points, and the result."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.parameters import parameter

_MIN_SPEED = 1e-3
"""A joint that hardly has to move gets this speed [rad/s]: 0 would mean full speed to a servo."""


@dataclass(frozen=True, slots=True)
class HeadCommand:
    """Where the two joints of a head are to go, and how fast.

    Attributes:
        pan: goal of the pan joint [rad].
        tilt: goal of the tilt joint [rad].
        pan_speed: speed to use on the way [rad/s], above 0.
        tilt_speed: the same for tilt.
    """

    pan: float
    tilt: float
    pan_speed: float
    tilt_speed: float


def together(
    present: tuple[float, float], goal: tuple[float, float], max_velocity: float
) -> HeadCommand:
    """A command that takes both joints to their goals at once, the farther one at full speed.

    Args:
        present: pan and tilt now [rad].
        goal: pan and tilt wanted [rad].
        max_velocity: the speed of the joint that has the longer way [rad/s].
    """
    ways = [abs(there - here) for here, there in zip(present, goal, strict=True)]
    longest = max(ways)
    speeds = [max_velocity * way / longest if longest > 0 else max_velocity for way in ways]
    return HeadCommand(*goal, *(max(speed, _MIN_SPEED) for speed in speeds))


@dataclass(frozen=True, slots=True)
class PointingParameters:
    """How to turn the head to a point."""

    max_velocity: float = parameter(
        2.0, "Speed of the joint that has the longer way.", unit="rad/s", minimum=0.02, maximum=12.0
    )
    success_angle_threshold: float = parameter(
        0.02, "The head has arrived when it misses by less.", unit="rad", minimum=0.0, maximum=3.2
    )
    settle_time: float = parameter(
        0.4,
        "How long the joints must stand still to be judged.",
        unit="s",
        minimum=0.05,
        maximum=10.0,
    )
    clamp_to_limits: bool = parameter(
        False, "Turn as far as the joints go to a target out of reach; else nothing moves."
    )


@dataclass(frozen=True, slots=True)
class PointingResult:
    """How a turn of the head ended, judged by the measured joints.

    Attributes:
        arrived: the axis goes through the point, give or take the threshold.
        miss: by how much it misses [rad].
    """

    arrived: bool
    miss: float

    def __str__(self) -> str:
        what = "arrived" if self.arrived else "did not arrive"
        return f"{what}: the head misses the target by {math.degrees(self.miss):.2f} degrees"
