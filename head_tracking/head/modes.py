"""What a head does with targets: it keeps on them, or turns to each once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from head_tracking.gaze import HeadCommand, PanTiltHead, PointingParameters, together
from head_tracking.head.head_control import HeadControl, TargetMode
from head_tracking.head.servo_memory import ServoMemory
from head_tracking.head.tasks import HeadReading
from head_tracking.tracking import (
    LAWS,
    EstimatorParameters,
    HeadBase,
    Learning,
    Refusal,
    SpeedLimits,
    TargetState,
    TargetStateParameters,
    Tracker,
    Turn,
)
from head_tracking.transforms import Vector3

_STILL = 0.006  # rad; a goal that differs by less is no new turn: a little over a tick of an AX-12


@dataclass(frozen=True, slots=True)
class FollowingSettings:
    """How a head follows a target.

    Attributes:
        law: a name in `LAWS`.
        limits: of all laws.
        law_parameters: of this law, of its class `Parameters`.
        estimator: what counts as the same target.
        state: what to do without one.
        servo_learning: what becomes of what is learned of the servos, a name in `Learning`.
        camera_learning: the same for a camera on the head.
    """

    law: str = "predictive"
    limits: SpeedLimits = field(default_factory=SpeedLimits)
    law_parameters: Any = None
    estimator: EstimatorParameters = field(default_factory=EstimatorParameters)
    state: TargetStateParameters = field(default_factory=TargetStateParameters)
    servo_learning: str = Learning.LEARN
    camera_learning: str = Learning.LEARN


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
        self._memory = ServoMemory({})

    def tune(self) -> None:
        """Use the settings as they are now."""
        settings, tracker = self._settings(), self.tracker
        if tracker is None:
            return
        if settings.law != self._law:
            self._law = settings.law
            tracker.law = LAWS[self._law](tracker.head, self._period)
            tracker.law.expect(self._memory.load())
        tracker.law.limits = settings.limits
        tracker.law.parameters = settings.law_parameters or tracker.law.Parameters()
        tracker.estimator.parameters = settings.estimator
        tracker.machine.parameters = settings.state
        self._learn(tracker, settings)

    def _learn(self, tracker: Tracker, settings: FollowingSettings) -> None:
        tracker.learn(Learning(settings.servo_learning), Learning(settings.camera_learning))
        if settings.servo_learning == Learning.FORGET:
            self._memory.forget()

    def use(self, control: HeadControl, head: PanTiltHead, base: HeadBase | None) -> None:
        """See `TargetMode`."""
        settings, before = self._settings(), self.tracker
        self._law, self._period = settings.law, control.period
        law = LAWS[self._law](head, self._period, settings.limits, settings.law_parameters)
        self.tracker = Tracker(head, law, settings.estimator, settings.state, base)
        self._memory = control.memory
        law.expect(self._memory.load())
        self._learn(self.tracker, settings)
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
        for joint in tracker.law.take_contradicted():
            control.warn(joint, f"{joint}: its servo is not as it was in the last run")
        if tracker.fault and not control.off:
            control.fail(tracker.fault, step.command)
            return None
        if step.error is not None and control.is_cautious:
            control.approached(step.error)
        return step.command

    def recenter(self, control: HeadControl, reading: HeadReading) -> HeadCommand | None:
        """See `TargetMode`; the next target is followed again."""
        assert self.tracker is not None
        self.tracker.recenter()
        return None

    def save(self, memory: ServoMemory) -> None:
        """See `TargetMode`."""
        if self.tracker is not None:
            memory.save(self.tracker.law.to_save)

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
        self._restart()

    def _restart(self) -> None:
        """Begin the next turn where the head is."""
        self._turn: Turn | None = None
        self._is_over = True
        self._point: Vector3 = (0.0, 0.0, 0.0)
        self._start = (0.0, 0.0)
        self._goal: tuple[float, float] | None = None

    def use(self, control: HeadControl, head: PanTiltHead, base: HeadBase | None) -> None:
        """See `TargetMode`."""
        self._restart()

    def reset(self, reason: str, now: float) -> HeadCommand | None:
        """See `TargetMode`; the servos end a turn that is under way."""
        self._restart()
        return None

    def enable(self, off: str, now: float) -> HeadCommand | None:
        """See `TargetMode`."""
        stop = None if self._is_over else self._stop
        self._restart()
        return stop

    def measured(self, reading: HeadReading) -> None:
        """See `TargetMode`."""
        self._stop = together(reading.positions, reading.positions, self._parameters().max_velocity)

    def step(self, control: HeadControl, reading: HeadReading) -> HeadCommand | None:
        """See `TargetMode`."""
        now = reading.now
        is_new = self._accept(control, reading)
        turn = self._turn
        if turn is None or control.off:
            control.error = None
            return None
        turn.aim(self._point, None, self._start, reading.positions, now)
        control.error = turn.miss
        result = None if self._is_over else turn.judge(now)
        if result is None and not self._is_over:
            return control.law.along(turn.positions, turn.max_velocity, reading.joints, now)
        if result is not None:
            self._is_over = True
            control.conclude(str(result), arrived=result.arrived)
        goal = HeadCommand(*turn.positions(now), turn.max_velocity, turn.max_velocity)
        return goal if is_new or result is not None else None

    def _accept(self, control: HeadControl, reading: HeadReading) -> bool:
        """Return whether there is a new point to turn to."""
        p, head, present = self._parameters(), control.head, reading.positions
        assert head is not None
        # At the end of a turn the head is where it was sent, not what its encoders can resolve: a
        # target a tenth of a degree above the axis, sent again and again, raises the head.
        start = self._goal or present
        if not _near(present, start, p.success_angle_threshold):
            start = present
        placed = control.take_latest_target(start, reading.now)
        control.take_refusal()
        if placed is None or control.off:
            return False
        target, point = placed
        gaze = head.gaze(point, *present)
        if not gaze.is_usable(clamp=p.clamp_to_limits):
            control.outcome = f"refused: {gaze.reason}"
            control.refuse(Refusal(target, f"nothing moves: {gaze.reason}"))
            return False
        if not gaze.reached:
            control.warn("limit", f"target {target}: {gaze.reason}")
        goal, before = (gaze.pan, gaze.tilt), self._goal
        self._point, self._goal = point, goal
        if self._is_over and (before is None or not _near(goal, before, _STILL)):
            self._turn = control.turn(p)
            self._start, self._is_over = present, False
        if not self._is_over:
            control.outcome = f"turning to {target}"
        return True

    def recenter(self, control: HeadControl, reading: HeadReading) -> HeadCommand | None:
        """See `TargetMode`."""
        self._restart()
        head = control.head
        assert head is not None
        centre = head.pan_limits.clamp(0.0), head.tilt_limits.clamp(0.0)
        velocity = min(self._parameters().max_velocity, control.fastest)
        return together(reading.positions, centre, velocity)

    def state(self, control: HeadControl) -> tuple[str, str]:
        """See `TargetMode`."""
        if control.off:
            return "disabled", f"disabled: {control.off}"
        if control.trouble:
            return "idle", f"idle: {control.trouble}"
        if control.task is not None:
            return "turning", control.task_state
        return "holding" if self._is_over else "turning", control.outcome


def _near(one: tuple[float, float], other: tuple[float, float], by: float) -> bool:
    return all(abs(a - b) < by for a, b in zip(one, other, strict=True))
