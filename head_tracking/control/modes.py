"""What a head does with targets: it keeps on them, or turns to each once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from head_tracking.control.head_control import HeadControl, TargetMode
from head_tracking.control.tasks import HeadReading
from head_tracking.gaze import HeadCommand, PanTiltHead, Pointing, PointingParameters
from head_tracking.tracking import (
    LAWS,
    EstimatorParameters,
    HeadBase,
    Refusal,
    SpeedLimits,
    TargetState,
    TargetStateParameters,
    Tracker,
)


@dataclass(frozen=True, slots=True)
class FollowingSettings:
    """How a head follows a target.

    Attributes:
        law: a name in `LAWS`.
        limits: of all laws.
        law_parameters: of this law, of its class `Parameters`.
        estimator: what counts as the same target.
        state: what to do without one.
    """

    law: str = "predictive"
    limits: SpeedLimits = field(default_factory=SpeedLimits)
    law_parameters: Any = None
    estimator: EstimatorParameters = field(default_factory=EstimatorParameters)
    state: TargetStateParameters = field(default_factory=TargetStateParameters)


class Following(TargetMode):
    """Keeps the head on its target.

    Args:
        settings: returns them as they are now.

    Attributes:
        tracker: of the head; None: the robot's model is not known.
    """

    title = "tracking"

    def __init__(self, settings: Callable[[], FollowingSettings] = FollowingSettings) -> None:
        self.tracker: Tracker | None = None
        self._settings = settings
        self._law = ""
        self._period = 0.0

    def tune(self) -> None:
        """Use the settings as they are now."""
        settings, tracker = self._settings(), self.tracker
        if tracker is None:
            return
        if settings.law != self._law:
            self._law = settings.law
            tracker.law = LAWS[self._law](tracker.head, self._period)
        tracker.law.limits = settings.limits
        tracker.law.parameters = settings.law_parameters or tracker.law.Parameters()
        tracker.estimator.parameters = settings.estimator
        tracker.machine.parameters = settings.state

    def use(self, control: HeadControl, head: PanTiltHead, base: HeadBase | None) -> None:
        """See `TargetMode`."""
        settings, before = self._settings(), self.tracker
        self._law, self._period = settings.law, control.period
        law = LAWS[self._law](head, self._period, settings.limits, settings.law_parameters)
        self.tracker = Tracker(head, law, settings.estimator, settings.state, base)
        if before is not None:
            control.send(before.reset("another robot_description has come", control.now))
        self.enable(control.off, control.now)

    def reset(self, reason: str, now: float) -> HeadCommand | None:
        """See `TargetMode`."""
        return None if self.tracker is None else self.tracker.reset(reason, now)

    def enable(self, off: str, now: float) -> HeadCommand | None:
        """See `TargetMode`."""
        if self.tracker is None:
            return None
        moving = self.tracker.state not in (TargetState.IDLE, TargetState.DISABLED)
        self.tracker.machine.off = off
        command = self.tracker.enable(not off, now)
        return command if moving else None

    def measured(self, reading: HeadReading) -> None:
        """See `TargetMode`."""
        if self.tracker is not None:
            self.tracker.joints_read(reading.stamp, reading.positions)

    def step(self, control: HeadControl, reading: HeadReading) -> HeadCommand | None:
        """See `TargetMode`."""
        tracker, now = self.tracker, reading.now
        assert tracker is not None
        for target, point in control.take_targets(reading):
            seen = target.stamp * 1e-9 if target.stamp else now
            moving = bool(target.stamp) and control.is_carried(target.frame_id)
            verdict = tracker.target_seen(seen, point, now, moving=moving)
            if not verdict.used and tracker.machine.refusal == verdict:
                control.refuse(Refusal(target, verdict))
        refused = control.take_refusal()
        if refused:
            tracker.machine.refused(refused, now)
        tracker.at_most = control.fastest
        step = tracker.step(now)
        control.error = step.error
        if tracker.fault and not control.off:
            control.fail(tracker.fault, step.command)
            return None
        if step.error is not None and control.is_cautious:
            control.approached(step.error)
        return step.command

    def recenter(self, reading: HeadReading) -> HeadCommand | None:
        """See `TargetMode`; the next target is followed again."""
        assert self.tracker is not None
        self.tracker.recenter()
        return None

    def state(self, control: HeadControl) -> tuple[str, str]:
        """See `TargetMode`."""
        if self.tracker is None or (control.trouble and self.tracker.machine.enabled):
            return TargetState.IDLE, f"{TargetState.IDLE}: {control.trouble}"
        machine = self.tracker.machine
        return machine.state, f"{machine.state}: {machine.reason}"


class LookingOnce(TargetMode):
    """Turns the head to each target once.

    Args:
        parameters: returns them as they are now.
    """

    title = "pointing"

    def __init__(self, parameters: Callable[[], PointingParameters]) -> None:
        self._parameters = parameters
        self._pointing: Pointing | None = None
        self._present: tuple[float, float] | None = None

    def use(self, control: HeadControl, head: PanTiltHead, base: HeadBase | None) -> None:
        """See `TargetMode`."""
        self._pointing = Pointing(head, self._parameters())

    def reset(self, reason: str, now: float) -> HeadCommand | None:
        """See `TargetMode`; a turn that is under way ends by itself."""
        self._restart()
        return None

    def enable(self, off: str, now: float) -> HeadCommand | None:
        """See `TargetMode`."""
        pointing = self._pointing
        self._restart()
        return (
            None if pointing is None or self._present is None else pointing.stop(self._present, now)
        )

    def _restart(self) -> None:
        """Begin the next turn where the head is."""
        if self._pointing is not None:
            self._pointing = Pointing(self._pointing.head, self._parameters())

    def measured(self, reading: HeadReading) -> None:
        """See `TargetMode`."""
        self._present = reading.positions

    def step(self, control: HeadControl, reading: HeadReading) -> HeadCommand | None:
        """See `TargetMode`."""
        pointing, (now, _, positions) = self._pointing, reading
        assert pointing is not None
        p = self._parameters()
        pointing.parameters = replace(p, max_velocity=min(p.max_velocity, control.fastest))
        command = self._accept(control, pointing, reading)
        if control.off:
            return None
        control.error = pointing.miss(positions)
        result = pointing.judge(positions, now)
        if result is not None:
            control.conclude(str(result), arrived=result.arrived)
        return command

    def _accept(
        self, control: HeadControl, pointing: Pointing, reading: HeadReading
    ) -> HeadCommand | None:
        start = pointing.start_from(reading.positions)
        placed = control.take_latest_target(start, reading.now)
        control.take_refusal()
        if placed is None or control.off:
            return None
        target, point = placed
        gaze, command = pointing.point_at(point, reading.positions, reading.now)
        if pointing.turning:
            control.outcome = f"turning to {target}"
        if command is None:
            control.outcome = f"refused: {gaze.reason}"
            control.refuse(Refusal(target, f"nothing moves: {gaze.reason}"))
        elif not gaze.reached:
            control.warn("limit", f"target {target}: {gaze.reason}")
        return command

    def recenter(self, reading: HeadReading) -> HeadCommand | None:
        """See `TargetMode`."""
        assert self._pointing is not None
        return self._pointing.recenter(reading.positions, reading.now)

    def state(self, control: HeadControl) -> tuple[str, str]:
        """See `TargetMode`."""
        if control.off:
            return "disabled", f"disabled: {control.off}"
        if control.trouble:
            return "idle", f"idle: {control.trouble}"
        if control.task is not None:
            return "turning", control.task.title
        turning = self._pointing is not None and self._pointing.turning
        return "turning" if turning else "holding", control.outcome
