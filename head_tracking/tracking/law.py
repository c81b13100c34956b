"""What a tracking law is: it turns a target into commands for the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from head_tracking.gaze import Gaze, HeadCommand
from head_tracking.parameters import parameter
from head_tracking.tracking.target_estimate import TargetEstimate


@dataclass(frozen=True, slots=True)
class JointReading:
    """The joints of the head at one moment.

    Attributes:
        stamp: when they were measured [s].
        positions: of pan and tilt [rad].
        velocities: of pan and tilt [rad/s].
    """

    stamp: float
    positions: tuple[float, float]
    velocities: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """What all laws have in common.

    The tutorials' `max_joint_speed` is 0.5 rad/s; the other laws need no such restraint.
    """

    max_joint_speed: float = parameter(
        0.0,
        "Fastest speed while tracking; 0: 0.5 rad/s with the law `speed` (the tutorials' value), "
        "5 rad/s with the others.",
        unit="rad/s",
        minimum=0.0,
        maximum=12.0,
    )
    lead_target_angle: float = parameter(
        0.5,
        "How far ahead of a moving joint its goal may be: so far it moves on if nobody speaks "
        "any more.",
        unit="rad",
        minimum=0.02,
        maximum=3.0,
    )

    def speed(self, usual: float) -> float:
        """The fastest speed for a law that usually needs `usual` [rad/s]."""
        return self.max_joint_speed or usual


class TrackingLaw(Protocol):
    """Steers the head. Times are in seconds, on the clock of the stamps.

    Every method is given the newest reading of the joints and the time.
    """

    @property
    def horizon(self) -> float:
        """How long after a command the head has moved as told [s]."""

    @property
    def delays(self) -> tuple[float, float]:
        """From a command to the motion it causes, of pan and tilt [s]."""

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """The command that keeps the head on a target, and the gaze it aims at."""

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """The command for a way to pan and tilt [rad], not faster than `speed` [rad/s]."""

    def stop(self, joints: JointReading, now: float) -> HeadCommand:
        """The command that stops the head at once: the goal is the present position."""
