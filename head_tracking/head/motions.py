"""The controllers of a head: each returns the command of every control cycle.

A `Motion` turns the head until it has a result: to a point, or along a trajectory. `Tracking` and
`Pointing` have no end: they control the head by its targets while there is no other motion.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from head_tracking.compatibility import StrEnum
from head_tracking.gaze import (
    Arrival,
    Gaze,
    HeadCommand,
    PanTiltHead,
    PointingParameters,
    PointingResult,
    together,
)
from head_tracking.head.obstacle import Blocked
from head_tracking.tracking import (
    LAWS,
    EstimatorParameters,
    JointPoint,
    JointReading,
    JointTrajectory,
    Learning,
    LearningParameters,
    PredictiveLaw,
    Refusal,
    SpeedLimits,
    Target,
    TargetStateParameters,
    Tracker,
    TrackingLaw,
    TrajectoryCode,
)
from head_tracking.transforms import TransformException, Vector3

if TYPE_CHECKING:
    from head_tracking.head.head_control import HeadControl

_PERIOD = 0.02  # s
_MOVING = 0.15  # rad/s; the measured velocity of a joint at rest can reach this
_RAMP = 0.2  # s of acceleration, and of braking
_STILL = 0.006  # rad; a joint that moved less stands still: a little over one tick of an AX-12
_ON_TARGET = 0.1  # s with a small miss after which the turn ends
_SMALL_MISS = 0.3  # of the threshold
_SMOOTHING = 0.15  # s over which the target's velocity is averaged
_LEAD_TIME = 0.3  # s for which that velocity is extrapolated at most
_RESERVE = 0.8  # of the speed limit after a STOP; the rest is for catching up
_SLOWEST = 1e-6  # rad/s
_LONGEST = 0.2  # s that pass between two updates
_SAME_GOAL = 0.006  # rad; a little over one tick of an AX-12


class MotionEnd(StrEnum):
    """How a motion ended."""

    SUCCEEDED = "succeeded"
    MISSED = "did not arrive"
    UNREACHABLE = "unreachable"
    NO_TRANSFORM = "no transform"
    PREEMPTED = "preempted"
    DISABLED = "disabled"
    CANCELED = "canceled"
    ABORTED = "aborted"
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class MotionResult:
    """The result of a motion.

    Attributes:
        end: how it ended.
        reason: why, for logs and clients.
        code: FollowJointTrajectory's `error_code`.
    """

    end: MotionEnd
    reason: str
    code: TrajectoryCode = TrajectoryCode.INVALID_GOAL

    def __str__(self) -> str:
        if self.end is MotionEnd.SUCCEEDED:
            return self.reason
        is_named = self.end in (MotionEnd.CANCELED, MotionEnd.REJECTED)
        return f"{self.end if is_named else MotionEnd.ABORTED}: {self.reason}"


class Motion(ABC):
    """A controller of the head. Its methods are called with the lock of `HeadControl` held.

    Args:
        notify: called with the motion in each cycle while it is in progress, and once when it has
            its result. None: it is one of a stream, and nobody waits for its result.

    Attributes:
        title: what it does.
        result: how it ended; None while it is in progress.
        miss: angle between the pointing axis and the target [rad]; None: there is no target.
        is_streamed: whether nobody waits for its result.
        notify: as given; it does nothing if that is None.
    """

    title = ""

    def __init__(self, notify: Callable[[Any], object] | None = None) -> None:
        self.result: MotionResult | None = None
        self.miss: float | None = None
        self.is_streamed = notify is None
        self.notify = notify or (lambda _: None)

    @abstractmethod
    def update(self, joints: JointReading, now: float) -> HeadCommand | None:
        """Return the command for the joints, which have just been measured; None: no command."""

    @abstractmethod
    def desired(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """Return the desired states of pan and tilt at a time [s]; None: there are none."""

    def end(
        self, end: MotionEnd, reason: str, code: TrajectoryCode = TrajectoryCode.INVALID_GOAL
    ) -> None:
        """Set the result, unless there is one."""
        if self.result is None:
            self.result = MotionResult(end, reason, code)
            self.notify(self)


class PointMotion(Motion):
    """A turn to a point, which may move, until the measured joints have arrived.

    The point moves with its frame, unless the head carries the frame: it would move with the head.

    Both joints start and arrive together; the one with the longer way moves as fast as `p` and the
    head allow, or slower if `min_duration` requires it. A joint that moves at the beginning brakes
    within 0.2 s, while the motion to the point begins.

    Args:
        p: how to turn. With `clamp_to_limits` the head turns as far as the joints go to a point
            out of reach; else that ends the motion. It has arrived when the miss was less than
            `success_angle_threshold` for `settle_time`, or very small for 0.1 s; and missed when
            the joints have stood still for `settle_time` and the point does not move.
        head: the head, pointing another frame; None: the usual one.
        min_duration: minimum duration [s].
        fixed: where the point stays in `fixed_frame`, shape (3,) [m]; None: see `target`.
    """

    def __init__(
        self,
        control: HeadControl,
        target: Target,
        p: PointingParameters,
        notify: Callable[[PointMotion], object] | None = None,
        head: PanTiltHead | None = None,
        min_duration: float = 0.0,
        fixed: Vector3 | None = None,
    ) -> None:
        super().__init__(notify)
        self._frames = control.frames
        head = head or self._frames.head
        assert head is not None
        self._head, self._p, self._min_duration = head, p, min_duration
        self.retarget(target, fixed)
        self._held = control.held_positions()
        self._speed = min(p.max_velocity, control.fastest)
        self._law = control.law
        pan, tilt = control.present()
        self._velocity = pan.velocity or 0.0, tilt.velocity or 0.0
        # where the joints would stand if they only braked
        self._start = (
            pan.position + 0.5 * _RAMP * self._velocity[0],
            tilt.position + 0.5 * _RAMP * self._velocity[1],
        )
        self._began = self._duration = 0.0
        self._located: float | None = None
        self._goal, self._rate = self._held, (0.0, 0.0)
        self._seen = 0.0
        self._settling = Arrival(p.success_angle_threshold, p.settle_time)
        self._ending = Arrival(_SMALL_MISS * p.success_angle_threshold, _ON_TARGET)
        self._standing, self._stood_at = Arrival(_STILL, p.settle_time), self._held

    def retarget(self, target: Target, fixed: Vector3 | None) -> None:
        """Turn to another point; see `PointMotion`."""
        self.title = f"turning {self._head.pointing_frame} to {target}"
        self.target, self._fixed = target, fixed

    def update(self, joints: JointReading, now: float) -> HeadCommand | None:
        """See `Motion`. After its result a motion computes its miss only."""
        self._frames.target = self.target
        moves = self.miss is not None
        located = self._located = now if self._located is None else self._located
        try:
            point, stamp = self._locate(now)
        except TransformException as error:
            if self.result is not None or now - located < self._frames.timeout:
                return None
            self.end(MotionEnd.NO_TRANSFORM, f"the target {self.target} has no transform: {error}")
            return self._law.stop(joints) if moves else None
        gaze, self._located = self._aim(point, stamp, joints.positions, now), now
        if self.result is not None:
            return None
        if not gaze.is_usable(clamp=self._p.clamp_to_limits):
            self.end(MotionEnd.UNREACHABLE, gaze.reason)
            return self._law.stop(joints) if moves else None
        result = self._judge(joints.positions, now)
        if result is None:
            return self._law.along(self._positions, self._speed, joints, now)
        if result.arrived:
            self.end(MotionEnd.SUCCEEDED, str(result), TrajectoryCode.SUCCESSFUL)
        else:
            reason = f" ({gaze.reason})" if gaze.reason else ""
            self.end(MotionEnd.MISSED, f"{result}{reason}")
        return self.goal(now)

    def goal(self, now: float) -> HeadCommand:
        """Return the command that goes where the joints should be now."""
        return HeadCommand(*self._positions(now), self._speed, self._speed)

    def desired(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """See `Motion`."""
        if self.miss is None:
            return None
        here, soon = self._positions(time), self._positions(time + _PERIOD)
        pan, tilt = (JointPoint(a, (b - a) / _PERIOD, 0.0) for a, b in zip(here, soon, strict=True))
        return pan, tilt

    def _locate(self, now: float) -> tuple[Vector3, float | None]:
        """Return the point in the head's base frame [m], and its stamp [s]; None: it stands still.

        Raises:
            TransformException: it is not known where the point is.
        """
        frames, target = self._frames, self.target
        if self._fixed is None:
            if not frames.moves_with_head(target.frame_id):
                return frames.latest_in_base(target)
            self._fixed = frames.in_fixed_frame(target, self._held)
        return frames.in_base(self._fixed, now), None

    def _aim(
        self, point: Vector3, stamp: float | None, present: tuple[float, float], now: float
    ) -> Gaze:
        """Set the point that was there at `stamp`; return the gaze at it, or the nearest one."""
        gaze = self._head.gaze(point, *self._goal)
        positions = gaze.pan, gaze.tilt
        if self.miss is None:
            self._began = now
            longest = max(abs(b - a) for a, b in zip(self._start, positions, strict=True))
            self._duration = max(self._min_duration, longest / self._speed + _RAMP)
        elif stamp is not None and stamp > self._seen:
            passed = stamp - self._seen
            share = min(1.0, passed / _SMOOTHING)
            pan, tilt = (
                rate + share * ((b - a) / passed - rate)
                for a, b, rate in zip(self._goal, positions, self._rate, strict=True)
            )
            self._rate = pan, tilt
        self.miss = self._head.miss(point, *present)
        self._goal, self._seen = positions, now if stamp is None else stamp
        return gaze

    def _judge(self, present: tuple[float, float], now: float) -> PointingResult | None:
        """Return the result by the measured positions; None while the turn is in progress."""
        assert self.miss is not None
        arrived = [each.step(self.miss, now) for each in (self._settling, self._ending)]
        moved = max(abs(a - b) for a, b in zip(present, self._stood_at, strict=True))
        if moved > _STILL:
            self._stood_at = present
        stands = self._standing.step(moved, now)
        if now < self._began + self._duration:
            return None
        if any(arrived):
            return PointingResult(True, self.miss)
        moves = max(map(abs, self._rate)) > _STILL
        if moves or not stands:
            return None
        return PointingResult(self.miss <= self._p.success_angle_threshold, self.miss)

    def _positions(self, time: float) -> tuple[float, float]:
        """Return the desired pan and tilt at a time [s]."""
        elapsed = time - self._began
        ratio = self._ratio(elapsed)
        left = max(0.0, _RAMP - max(0.0, elapsed))  # s of braking
        ahead = min(max(time - self._seen, 0.0), _LEAD_TIME)
        pan, tilt = (
            start - 0.5 * velocity * left * left / _RAMP + ratio * (goal + ahead * rate - start)
            for start, velocity, goal, rate in zip(
                self._start, self._velocity, self._goal, self._rate, strict=True
            )
        )
        return self._head.pan_limits.clamp(pan), self._head.tilt_limits.clamp(tilt)

    def _ratio(self, elapsed: float) -> float:
        """Return the completed fraction of the way: a trapezoidal velocity profile."""
        whole = self._duration
        ramp = min(_RAMP, 0.5 * whole)
        if ramp <= 0.0 or elapsed >= whole:
            return 1.0
        left = whole - elapsed
        if elapsed <= 0.0:
            return 0.0
        speed = 1.0 / (whole - ramp)
        if elapsed < ramp:
            return 0.5 * speed * elapsed * elapsed / ramp
        if left < ramp:
            return 1.0 - 0.5 * speed * left * left / ramp
        return speed * (elapsed - 0.5 * ramp)


class TrajectoryMotion(Motion):
    """A trajectory of both joints, until the measured joints are at its end.

    After a STOP its time passes as slowly as the speed limit requires. While this process is held
    up it hardly passes: the head would hurry to catch up.
    """

    title = "following a trajectory"

    def __init__(
        self,
        trajectory: JointTrajectory,
        law: PredictiveLaw,
        notify: Callable[[TrajectoryMotion], object] | None = None,
    ) -> None:
        super().__init__(notify)
        self._trajectory, self._law = trajectory, law
        self._rate, self._late, self._now = 1.0, 0.0, 0.0

    def update(self, joints: JointReading, now: float) -> HeadCommand | None:
        """See `Motion`."""
        if 0.0 < self._now < now - _LONGEST:
            self._late, self._now = self._late + now - self._now - _LONGEST, now
        trajectory, law, time = self._trajectory, self._law, self._passed(now)
        fastest = max(abs(point.velocity or 0.0) for point in trajectory.at(time))
        self._late, self._now = now - time, now
        self._rate = min(1.0, _RESERVE * law.at_most / max(fastest, _SLOWEST))
        result = trajectory.judge(self._passed(joints.stamp), joints.positions, time)
        if result is None:
            return law.along(self._positions, law.fastest, joints, now)
        if result.code is TrajectoryCode.SUCCESSFUL:
            self.end(MotionEnd.SUCCEEDED, result.text, result.code)
            return HeadCommand(*self._positions(now), law.fastest, law.fastest)
        self.end(MotionEnd.ABORTED, result.text, result.code)
        return law.stop(joints)

    def desired(self, time: float) -> tuple[JointPoint, JointPoint]:
        """See `Motion`."""
        rate = self._rate
        pan, tilt = (
            JointPoint(position, rate * (velocity or 0.0), rate * rate * (acceleration or 0.0))
            for position, velocity, acceleration in self._trajectory.at(self._passed(time))
        )
        return pan, tilt

    def _positions(self, time: float) -> tuple[float, float]:
        pan, tilt = self._trajectory.at(self._passed(time))
        return pan.position, tilt.position

    def _passed(self, time: float) -> float:
        """Return the time of the trajectory at a time [s] near the latest update."""
        return time - self._late - (1.0 - self._rate) * (time - self._now)


class TargetMotion(Motion):
    """What a head does with its targets. It has no result, and controls the head of `control`."""

    control: HeadControl

    def use(self, control: HeadControl) -> None:
        """Use the head of `control`, whose model is known now or has changed."""
        self.control = control

    @abstractmethod
    def restart(self) -> HeadCommand | None:
        """Forget the target; return the command that stops the head, if this moves it."""

    def reset(self, reason: str) -> HeadCommand | None:
        """Forget everything measured, because the clock has jumped; return a command to stop."""
        return self.restart()

    @abstractmethod
    def recenter(self, joints: JointReading) -> HeadCommand | None:
        """Turn the head to its centre from now on."""

    @abstractmethod
    def state(self) -> tuple[str, str]:
        """Return the state, as a code and as text, of a head that is enabled and measured."""


@dataclass(frozen=True, slots=True)
class TrackingSettings:
    """How a head tracks its target.

    Attributes:
        law: a name in `LAWS`.
        law_parameters: of this law, of its class `Parameters`.
    """

    law: str = "predictive"
    limits: SpeedLimits = field(default_factory=SpeedLimits)
    law_parameters: Any = None
    estimator: EstimatorParameters = field(default_factory=EstimatorParameters)
    state: TargetStateParameters = field(default_factory=TargetStateParameters)
    learning: LearningParameters = field(default_factory=LearningParameters)


class Tracking(TargetMotion):
    """Keeps the head on a moving target.

    Attributes:
        tracker: of the head; None: no model is known.
    """

    title = "tracking"

    def __init__(self, settings: TrackingSettings) -> None:
        super().__init__()
        self.tracker: Tracker | None = None
        self._settings = settings

    def use(self, control: HeadControl) -> None:
        """See `TargetMotion`."""
        super().use(control)
        head, before = control.frames.head, self.tracker
        assert head is not None
        law = self._new_law(head)
        self.tracker = Tracker(head, law, base=control.frames.base, readings=control.readings)
        self.tune(self._settings)
        if before is not None:
            control.send(before.reset("the model or its limits have changed"))

    def tune(self, settings: TrackingSettings) -> None:
        """Use other settings from now on."""
        before, self._settings, tracker = self._settings, settings, self.tracker
        if tracker is None:
            return
        if settings.law != before.law:
            tracker.law = self._new_law(tracker.head)
        tracker.law.limits = settings.limits
        tracker.law.parameters = settings.law_parameters or tracker.law.Parameters()
        tracker.estimator.parameters = settings.estimator
        tracker.machine.parameters = settings.state
        if settings.learning is not tracker.camera.parameters:  # or it would forget again
            tracker.learn(settings.learning)
            if settings.learning.servo_learning == Learning.FORGET:
                self.control.memory.forget()

    def _new_law(self, head: PanTiltHead) -> TrackingLaw:
        """Return the law of the settings; it shares the servo models of the other motions."""
        control = self.control
        return LAWS[self._settings.law](head, control.period, servos=control.law.servos)

    def update(self, joints: JointReading, now: float) -> HeadCommand | None:
        """See `Motion`."""
        tracker, control, frames = self.tracker, self.control, self.control.frames
        assert tracker is not None
        refused: Target | None = None
        for target, point in frames.take(now, joints.positions):
            seen = target.stamp * 1e-9 if target.stamp else now
            moving = bool(target.stamp) and frames.moves_with_head(target.frame_id)
            if not tracker.target_seen(seen, point, now, moving=moving).used:
                refused = target
        refusal = frames.take_refusal()
        if refusal is not None:
            tracker.machine.refused(refusal.reason, now)
            refused = refusal.target
        tracker.law.at_most = control.law.at_most
        step = tracker.step(now)
        reason, refused = tracker.machine.take_refusal(), refused or frames.target
        if reason and refused is not None:
            control.refuse(Refusal(refused, reason))
        control.refusal = tracker.machine.refusal
        self.miss, control.held = step.error, None
        if tracker.camera.fault:
            control.send(step.command)
            control.disable(Blocked.FAULT, tracker.camera.fault)
            return None
        return step.command

    def desired(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """See `Motion`: the measured states of a head that moves."""
        joints = self.control.readings.latest
        if joints is None or max(map(abs, joints.velocities)) < _MOVING:
            return None
        (pan, tilt), (pan_velocity, tilt_velocity) = joints.positions, joints.velocities
        return JointPoint(pan, pan_velocity), JointPoint(tilt, tilt_velocity)

    def restart(self) -> HeadCommand | None:
        """See `TargetMotion`."""
        self.miss = None
        return None if self.tracker is None else self.tracker.restart()

    def reset(self, reason: str) -> HeadCommand | None:
        """See `TargetMotion`."""
        return None if self.tracker is None else self.tracker.reset(reason)

    def recenter(self, joints: JointReading) -> HeadCommand | None:
        """See `TargetMotion`."""
        assert self.tracker is not None
        self.tracker.recenter()
        return None

    def state(self) -> tuple[str, str]:
        """See `TargetMotion`."""
        assert self.tracker is not None
        machine = self.tracker.machine
        return machine.state, f"{machine.state}: {machine.reason}"


class Pointing(TargetMotion):
    """Turns the head to each new target once, and holds."""

    title = "pointing"

    def __init__(self, parameters: Callable[[], PointingParameters]) -> None:
        super().__init__()
        self._parameters = parameters
        self._motion: PointMotion | None = None
        self._goal: tuple[float, float] | None = None  # of the latest target

    def update(self, joints: JointReading, now: float) -> HeadCommand | None:
        """See `Motion`."""
        control, is_new = self.control, self._accept(joints, now)
        motion = self._motion
        if motion is None:
            return None
        was_turning = motion.result is None
        command = motion.update(joints, now)
        self.miss = motion.miss
        if is_new and not was_turning:
            command = motion.goal(now)
            control.held = command.pan, command.tilt
        return command

    def _accept(self, joints: JointReading, now: float) -> bool:
        """Use the latest target; return whether there is a new one."""
        control, frames, p = self.control, self.control.frames, self._parameters()
        placed, refusal = frames.take(now, control.held_positions(), latest_only=True), None
        if not placed or frames.head is None:
            refusal = frames.take_refusal()
        else:
            ((target, point),) = placed
            try:
                gaze = frames.head.gaze(frames.in_base(point, now), *joints.positions)
            except TransformException as error:
                refusal = Refusal(target, str(error))
            else:
                if not gaze.is_usable(clamp=p.clamp_to_limits):
                    control.reject(gaze.reason)
                    refusal = Refusal(target, f"nothing moves: {gaze.reason}")
        if refusal is not None:
            control.refuse(refusal)
        if not placed or refusal is not None:
            return False
        control.refusal = ""
        if not gaze.reached:
            control.warn("limit", f"target {target}: {gaze.reason}")

        before, goal = self._goal, (gaze.pan, gaze.tilt)
        self._goal, motion = goal, self._motion
        is_same = before is not None and math.dist(before, goal) < _SAME_GOAL
        if motion is not None and (motion.result is None or is_same):
            motion.retarget(target, point)
        else:
            notify = control.conclude
            self._motion = PointMotion(control, target, p, notify, fixed=point)
        return True

    def desired(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """See `Motion`."""
        motion = self._motion
        return None if motion is None or motion.result is not None else motion.desired(time)

    def restart(self) -> HeadCommand | None:
        """See `TargetMotion`."""
        was_turning = self._motion is not None and self._motion.result is None
        self._forget()
        joints = self.control.readings.latest if was_turning else None
        return None if joints is None else self.control.law.stop(joints)

    def recenter(self, joints: JointReading) -> HeadCommand | None:
        """See `TargetMotion`."""
        self._forget()
        control, head = self.control, self.control.frames.head
        assert head is not None
        centre = head.pan_limits.clamp(0.0), head.tilt_limits.clamp(0.0)
        velocity = min(self._parameters().max_velocity, control.fastest)
        return together(joints.positions, centre, velocity)

    def state(self) -> tuple[str, str]:
        """See `TargetMotion`."""
        if self._motion is not None and self._motion.result is None:
            return "turning", f"turning to {self._motion.target}"
        return "holding", str(self.control.result or "no target has come yet")

    def _forget(self) -> None:
        self.miss = self._motion = self._goal = None
