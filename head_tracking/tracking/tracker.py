"""Keeps a head on a moving target: gaze, tracking law and lost-target policy together."""

from __future__ import annotations

from dataclasses import dataclass

from head_tracking.gaze import Gaze, GazeStatus, HeadCommand, PanTiltHead, together
from head_tracking.tracking.lost_target import LostTargetPolicy, TargetState
from head_tracking.tracking.speed_law import SpeedLaw
from head_tracking.transforms import Vector3


@dataclass(frozen=True, slots=True)
class TrackingStep:
    """What one step of the tracker came to.

    Attributes:
        command: for the joints; None: leave them alone.
        gaze: at the target; None without one.
        error: angle between the measured pointing axis and the target [rad]; None without one.
    """

    command: HeadCommand | None = None
    gaze: Gaze | None = None
    error: float | None = None


class Tracker:
    """Follows targets given in the head's base frame. Times are in seconds, on any clock."""

    def __init__(self, head: PanTiltHead, law: SpeedLaw, lost_target: LostTargetPolicy) -> None:
        self.head = head
        self.law = law
        self.lost_target = lost_target
        self._target: Vector3 | None = None
        self._held: tuple[float, float] | None = None

    @property
    def state(self) -> TargetState:
        """What the head is doing about its target."""
        return self.lost_target.state

    def target_seen(self, target: Vector3, now: float) -> None:
        """Takes the newest target, shape (3,) [m], in the head's base frame."""
        self._target = target
        self.lost_target.seen(now)

    def step(self, present: tuple[float, float], now: float) -> TrackingStep:
        """What to do now, with the joints at `present` [rad]."""
        command = self.lost_target.step(present, now)
        if self.state is not TargetState.TRACKING:
            self._target = None
            self.law.reset()
        if self._target is None:
            return TrackingStep(command)
        gaze = self.head.gaze(self._target, *present)
        error = self.head.miss(self._target, *present)
        if gaze.status in (GazeStatus.REACHED, GazeStatus.ON_PAN_AXIS):
            self._held = None
            limits = (self.head.pan_limits, self.head.tilt_limits)
            return TrackingStep(self.law.step((gaze.pan, gaze.tilt), present, limits), gaze, error)
        self.law.reset()
        return TrackingStep(self._hold(present), gaze, error)

    def stop(self, present: tuple[float, float]) -> HeadCommand:
        """Forgets the target; the command that stops the head where it is."""
        self._forget()
        return together(present, present, self.law.parameters.max_joint_speed)

    def recenter(self, present: tuple[float, float]) -> HeadCommand:
        """Forgets the target; the command that takes both joints to 0 or the limit next to it."""
        self._forget()
        centre = self.head.pan_limits.clamp(0.0), self.head.tilt_limits.clamp(0.0)
        return together(present, centre, self.lost_target.parameters.default_joint_speed)

    def _hold(self, present: tuple[float, float]) -> HeadCommand:
        if self._held is None:
            self._held = present
        return together(present, self._held, self.law.parameters.max_joint_speed)

    def _forget(self) -> None:
        self._target, self._held = None, None
        self.law.reset()
        self.lost_target.forget()
