"""Commands: what other threads ask of a joint, checked before anything happens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from head_tracking.dynamixel.exceptions import GoalError


class Torque(Enum):
    """Why a servo holds or does not hold its position."""

    OFF_UNTIL_COMMANDED = "relaxed; the first command switches torque on"
    OFF_ON_REQUEST = "relaxed on request; commands are refused"
    OFF_TO_COOL = "relaxed to cool down; commands are refused until then"
    OFF_BY_FAULT = "shut down by itself; commands are refused until it has recovered"
    OFF_STOPPED = "stopped on request; commands are refused until it is started"
    ON = "torque on"

    @property
    def waits(self) -> bool:
        """Whether commands are refused."""
        return self not in (Torque.ON, Torque.OFF_UNTIL_COMMANDED)


@dataclass(frozen=True, slots=True)
class Goal:
    """Where a joint shall go.

    Attributes:
        position: Goal, rad.
        speed: Speed to go there, rad/s; None stands for the joint's own speed.
    """

    position: float
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class CommandResult:
    """What became of an accepted command.

    Attributes:
        positions: Goal positions taken over, rad, by joint; within the limits.
        clamped: By how much a position was moved to reach the limit (taken over minus asked), rad,
            for the joints where it was.
        lost: Joints whose goal was dropped because their servo does not answer.
    """

    positions: Mapping[str, float]
    clamped: Mapping[str, float]
    lost: tuple[str, ...]


def check_finite(joint_name: str, goal: Goal) -> None:
    """Refuse what is no number, and speeds that are not above 0.

    Raises:
        GoalError: The position is not finite, or the speed not finite or not above 0.
    """
    if not math.isfinite(goal.position):
        raise GoalError(
            f"{joint_name}: goal position {goal.position} refused; it must be a finite number of "
            "radians"
        )
    if goal.speed is not None:
        check_speed(joint_name, goal.speed)


def check_speed(joint_name: str, speed: float) -> None:
    """Refuse a speed that is not finite or not above 0.

    Raises:
        GoalError: It is not.
    """
    if not (math.isfinite(speed) and speed > 0.0):
        raise GoalError(
            f"{joint_name}: speed {speed} rad/s refused; it must be finite and above 0. To stop a "
            "joint, hold it"
        )


def within_limits(
    joint_name: str, position: float, lower: float, upper: float, tolerance: float, clamp: bool
) -> float:
    """Return the position moved into the limits.

    Args:
        joint_name: For the message.
        position: Asked position, rad.
        lower: Lowest position, rad.
        upper: Highest position, rad.
        tolerance: Excess that counts as being on the limit, rad.
        clamp: Whether a larger excess is accepted too.

    Raises:
        GoalError: The position is outside by more than the tolerance, and `clamp` is false.
    """
    inside = min(max(position, lower), upper)
    if not clamp and abs(position - inside) > tolerance:
        raise GoalError(
            f"{joint_name}: goal position {position:.4f} rad refused; allowed are {lower:.4f} to "
            f"{upper:.4f} rad"
        )
    return inside
