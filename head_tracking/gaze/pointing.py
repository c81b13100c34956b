"""Turning the head to one point, and telling whether it got there."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.gaze.head import Gaze, GazeStatus, PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.transforms import Vector3

_MIN_SPEED = 1e-3
"""A joint that hardly has to move gets this speed [rad/s]: 0 would mean full speed to a servo."""

_STILL = 0.006
"""A joint that moved less [rad] did not move: a little over one tick of an AX-12."""

_START = 1.0
"""So much longer [s] than at rest after a motion a head may stand that has not moved yet: its
torque may have to come on first."""


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


class Pointing:
    """Turns a head to points given in its base frame. Times are in seconds, on any clock."""

    def __init__(self, head: PanTiltHead, parameters: PointingParameters) -> None:
        self.head = head
        self.parameters = parameters
        self._target: Vector3 | None = None
        self._command: HeadCommand | None = None
        self._judged = True
        self._rest = (0.0, 0.0)
        self._still_since = 0.0
        self._moved = False

    @property
    def commanded(self) -> tuple[float, float] | None:
        """The last commanded pan and tilt [rad], unrounded by any servo."""
        return None if self._command is None else (self._command.pan, self._command.tilt)

    @property
    def turning(self) -> bool:
        """Whether a turn is under way that has not been judged."""
        return not self._judged

    def start_from(self, present: tuple[float, float]) -> tuple[float, float]:
        """Where the head stands [rad] for a target that moves with it.

        At the end of a turn that is where it was sent, not what its encoders can resolve: a
        target a tenth of a degree above the axis, sent again and again, raises the head even if
        one servo tick is more.
        """
        commanded = self.commanded
        if commanded is None:
            return present
        near = all(
            abs(there - here) < self.parameters.success_angle_threshold
            for here, there in zip(present, commanded, strict=True)
        )
        return commanded if near else present

    def point_at(
        self, target: Vector3, present: tuple[float, float], now: float
    ) -> tuple[Gaze, HeadCommand | None]:
        """The gaze at `target` [m, base frame] and the command for it; None if it is refused."""
        gaze = self.head.gaze(target, *present)
        allowed = {GazeStatus.REACHED}
        if self.parameters.clamp_to_limits:
            allowed |= {GazeStatus.OUT_OF_REACH, GazeStatus.ON_PAN_AXIS}
        if gaze.status not in allowed:
            return gaze, None
        self._target = target
        return gaze, self._go((gaze.pan, gaze.tilt), present, now)

    def recenter(self, present: tuple[float, float], now: float) -> HeadCommand:
        """The command that takes both joints to 0, or to the limit nearest to it."""
        self._target = None
        return self._go(
            (self.head.pan_limits.clamp(0.0), self.head.tilt_limits.clamp(0.0)), present, now
        )

    def stop(self, present: tuple[float, float], now: float) -> HeadCommand | None:
        """The command that ends a turn where the head is; None if none is under way."""
        self._target = None
        return None if self._judged else self._go(present, present, now)

    def miss(self, present: tuple[float, float]) -> float | None:
        """By how much the head misses its target now [rad]; None without one."""
        return None if self._target is None else self.head.miss(self._target, *present)

    def judge(self, present: tuple[float, float], now: float) -> PointingResult | None:
        """The result, once, when the joints have come to rest after a command."""
        if any(abs(a - b) > _STILL for a, b in zip(present, self._rest, strict=True)):
            self._rest, self._still_since = present, now
            self._moved = True
        miss, patience = self.miss(present), self.parameters.settle_time
        if self._judged or miss is None:
            return None
        arrived = miss <= self.parameters.success_angle_threshold
        if now - self._still_since < patience + (0.0 if arrived or self._moved else _START):
            return None
        self._judged = True
        return PointingResult(arrived, miss)

    def _go(
        self, goal: tuple[float, float], present: tuple[float, float], now: float
    ) -> HeadCommand:
        moved = self.commanded is None or any(
            abs(a - b) > _STILL for a, b in zip(goal, self.commanded, strict=True)
        )
        if moved:
            self._judged = self._moved = False
            self._rest, self._still_since = present, now
        self._command = together(present, goal, self.parameters.max_velocity)
        return self._command
