"""What a tracking law is: it turns a target into commands for the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from head_tracking.gaze import Gaze, HeadCommand, PanTiltHead
from head_tracking.tracking.estimator import TargetEstimate
from head_tracking.tracking.law_parameters import LawParameters


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


def inside(head: PanTiltHead, positions: tuple[float, float]) -> tuple[float, float]:
    """Pan and tilt [rad], or the limits next to them: an encoder may read a little beyond."""
    return head.pan_limits.clamp(positions[0]), head.tilt_limits.clamp(positions[1])


class TrackingLaw(Protocol):
    """Steers the head. Times are in seconds, on the clock of the stamps.

    Every method is given the newest reading of the joints and the time.

    Attributes:
        parameters: may change at any time.
    """

    parameters: LawParameters

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
