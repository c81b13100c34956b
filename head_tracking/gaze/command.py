"""What a head is told to do."""

from __future__ import annotations

from dataclasses import dataclass


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
    return HeadCommand(*goal, *(max(speed, MIN_SPEED) for speed in speeds))


MIN_SPEED = 1e-3
"""A joint that hardly has to move gets this speed [rad/s]: 0 would mean full speed to a servo."""
