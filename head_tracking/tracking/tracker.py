"""Keeps a head on a moving target: estimate, tracking law and target state machine together."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

from head_tracking.gaze import Gaze, HeadCommand, PanTiltHead, Sight
from head_tracking.tracking.estimator import (
    EstimatorParameters,
    TargetEstimate,
    TargetEstimator,
    Verdict,
)
from head_tracking.tracking.following import FollowingWatch
from head_tracking.tracking.laws import JointReading, TrackingLaw
from head_tracking.tracking.mounting import Mounting
from head_tracking.tracking.stamp_error import StampError
from head_tracking.tracking.target import HeadBase
from head_tracking.tracking.target_state import (
    TargetState,
    TargetStateMachine,
    TargetStateParameters,
)
from head_tracking.transforms import Rotation, Vector3

_VELOCITY_WINDOW = 0.06  # s
_SMOOTHING = 0.05  # of a delay, from one step to the next
_INSTANT = 1e-3  # s
CAUTIOUS_SPEED = 0.3
"""The greatest speed of a head after a stop, until it is on its target [rad/s]."""
_SAID = (Verdict.FUTURE, Verdict.TOO_OLD, Verdict.TOO_CLOSE)  # also while others are followed


@dataclass(frozen=True, slots=True)
class TrackingStep:
    """What one step of the tracker came to.

    Attributes:
        command: for the joints; None: leave them alone.
        gaze: at the target; None without one.
        error: angle between the measured pointing axis and where the target was when the joints
            were measured [rad]; None without a target.
    """

    command: HeadCommand | None = None
    gaze: Gaze | None = None
    error: float | None = None


@dataclass(frozen=True, slots=True)
class Delays:
    """How late everything is.

    Attributes:
        message: age of a point when it comes [s].
        interval: between points [s].
        reading: age of a joint's measurement when it is used [s].
        servos: from a command to the motion it causes, of pan and tilt [s].
        deviations: standard deviations of `servos` [s].
    """

    message: float
    interval: float
    reading: float
    servos: tuple[float, float]
    deviations: tuple[float, float]


class Tracker:
    """Follows targets given in a frame that stands still.

    Times are in seconds, on the clock of the stamps; it may be any clock.

    Args:
        head: the head to turn.
        law: steers it.
        estimator: what counts as the same target.
        state: what to do without one.
        base: where the head's base frame is; None: it is the frame in which targets are given.

    Attributes:
        head: the head that is turned.
        law: may be changed for another one at any time.
        at_most: no motion is faster than this [rad/s] for the time being, whatever is allowed.
        machine: the target state machine.
        mounting: finds out whether the head is mounted as it should be.
        fault: how it is not, as its camera sees it; it is switched off then, until it is enabled
            anew. Empty: nothing is known to be wrong.
    """

    def __init__(
        self,
        head: PanTiltHead,
        law: TrackingLaw,
        estimator: EstimatorParameters = EstimatorParameters(),  # noqa: B008
        state: TargetStateParameters = TargetStateParameters(),  # noqa: B008
        base: HeadBase | None = None,
    ) -> None:
        self.head = head
        self.law = law
        self.estimator = TargetEstimator(estimator)
        self.machine = TargetStateMachine(head, state)
        self.fault = ""
        self.at_most = math.inf
        self._base = base
        self._stall_watches = (
            FollowingWatch(head.pan_joint),
            FollowingWatch(head.tilt_joint),
        )
        self._readings: deque[JointReading] = deque()
        self.stamp_error = StampError()
        self.mounting = Mounting(head)
        self._seen: deque[tuple[float, Sight]] = deque()
        self._upright = Rotation.identity()
        self._message_age = self._reading_age = 0.0
        self._interval = 0.0
        self._came: float | None = None

    @property
    def state(self) -> TargetState:
        """What the head is doing about its target."""
        return self.machine.state

    @property
    def delays(self) -> Delays:
        """How late everything is, as measured."""
        law = self.law
        ages = self._message_age, self._interval, self._reading_age
        return Delays(*ages, law.delays, law.deviations)

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """Takes pan and tilt [rad] as measured at `stamp` [s]; only newer ones count."""
        readings = self._readings
        if readings and stamp <= readings[-1].stamp:
            return
        while len(readings) > 1 and readings[1].stamp <= stamp - _VELOCITY_WINDOW:
            readings.popleft()
        pan = tilt = 0.0
        if readings and stamp - readings[0].stamp < 5.0 * _VELOCITY_WINDOW:
            before, dt = readings[0].positions, stamp - readings[0].stamp
            pan, tilt = (positions[0] - before[0]) / dt, (positions[1] - before[1]) / dt
        readings.append(JointReading(stamp, positions, (pan, tilt)))
        self.stamp_error.joints_read(stamp, positions)
        self.mounting.joints_read(stamp, positions)

    def target_seen(
        self, stamp: float, point: Vector3, now: float, *, moving: bool = False
    ) -> Verdict:
        """Takes a point.

        Args:
            stamp: when it was seen [s].
            point: shape (3,) [m], in the frame that stands still.
            now: the time [s].
            moving: whether it was seen by something that moves with the head.
        """
        if not self.machine.enabled:
            return Verdict.IGNORED
        estimate = self.estimator.estimate
        if estimate is not None:
            pan, tilt, _ = estimate.sight
        else:
            pan, tilt = self._readings[-1].positions if self._readings else (0.0, 0.0)
        if self._base is not None:
            place = self._base.at(stamp)
            if estimate is None:
                self._upright = place.rotation
            x, y, z = (a - b for a, b in zip(point, place.translation, strict=True))
            point = self._upright.inverse() @ (x, y, z)
        sight = self.head.sight(point, pan, tilt)
        if sight is None:
            verdict = Verdict.TOO_CLOSE
        else:
            if moving:
                self.fault = self.fault or self.mounting.point_seen(stamp, sight)
            sight = self._unerring(stamp, sight, moving)
            stamp -= self.stamp_error.value if moving else 0.0
            verdict = self.estimator.add(stamp, sight, now)
        if verdict.used:
            new = verdict is Verdict.NEW_TARGET
            self.machine.seen(now, new=new)
            if new:
                self.stamp_error.new_target()
            self._message_age += (1.0 if new else _SMOOTHING) * (now - stamp - self._message_age)
            if self._came is not None and not new:
                self._interval += _SMOOTHING * (now - self._came - self._interval)
            self._came = now
        elif verdict in (Verdict.FUTURE, Verdict.TOO_OLD, Verdict.TOO_CLOSE) or not self._follows(
            now
        ):
            self.machine.refused(verdict, now)
        return verdict

    def _unerring(self, stamp: float, sight: Sight, moving: bool) -> Sight:
        """The point as it is without its stamp's error, if it is of a camera on the head."""
        error = self.stamp_error
        self._seen.append((stamp, sight))
        while self._seen[0][0] < stamp - 1.0:
            self._seen.popleft()
        if error.point_seen(stamp, sight, moving=moving):
            self.estimator.reset()
            for then, seen in sorted(self._seen)[:-1]:
                then_corrected = then - error.value
                self.estimator.add(then_corrected, error.corrected(then, seen), then_corrected)
        return error.corrected(stamp, sight) if moving else sight

    def step(self, now: float) -> TrackingStep:
        """What to do now; nothing before the joints were read."""
        if not self._readings or not self.machine.enabled:
            return TrackingStep()
        if self.fault:
            self.machine.off = self.fault
            return TrackingStep(self.enable(False, now))
        self.law.at_most = self.at_most
        joints = self._readings[-1]
        self._reading_age += _SMOOTHING * (now - joints.stamp - self._reading_age)
        estimate = self.estimator.estimate
        if estimate is not None and self._follows(now):
            target = self._from_base(estimate, now)
            if target is None:
                return TrackingStep()
            command, gaze = self.law.follow(target, joints, now)
            there = self.head.point(target.sight_at(joints.stamp))
            error = self.head.miss(there, *joints.positions)
            self.machine.followed(gaze, error, now)
            ahead = self._message_age + 0.5 * self._interval + self.law.horizon
            self.estimator.horizon += _SMOOTHING * (ahead - self.estimator.horizon)
            self._watch_servos(command, joints, now)
            return TrackingStep(command, gaze, error)
        goal = self.machine.goal(joints.positions, now)
        if goal is None:
            return TrackingStep()
        speed = min(self.machine.parameters.default_joint_speed, self.law.at_most)
        command = self.law.go_to(goal, speed, joints, now)
        self._watch_servos(command, joints, now)
        return TrackingStep(command)

    def enable(self, on: bool, now: float) -> HeadCommand | None:
        """Follows targets from now on, or stops the head at once; the command for that."""
        if on and self.machine.enabled:
            return None
        self.estimator.reset()
        if on:
            self.fault = ""
            self.mounting.reset()
        self.machine.enable(on)
        return None if on else self._stop(now)

    def recenter(self) -> None:
        """Forgets the target and takes both joints to 0 or the limit next to it."""
        self.estimator.reset()
        self.machine.recenter()

    def reset(self, reason: str, now: float) -> HeadCommand | None:
        """Starts anew, as after a jump of the clock; what was switched off stays off.

        Joints, target, delays and what the law was about are forgotten.

        Args:
            reason: why, for the state.
            now: the time [s], on the clock as it is from now on.

        Returns:
            The command that stops the head where it was last measured; None if it is not on its
            way anywhere.
        """
        moving = self.machine.state not in (TargetState.IDLE, TargetState.DISABLED)
        command = self._stop(now)
        self._readings.clear()
        self._message_age = self._reading_age = self._interval = 0.0
        self._came = None
        self._seen.clear()
        self.stamp_error.reset()
        self.mounting.reset()
        self.estimator.reset()
        self.machine.forget(f"{reason}; no target has come since")
        return command if moving else None

    def _follows(self, now: float) -> bool:
        return self.machine.follows(now, self.estimator.parameters.target_timeout)

    def _stop(self, now: float) -> HeadCommand | None:
        for watch in self._stall_watches:
            watch.restart()
        return self.law.stop(self._readings[-1], now) if self._readings else None

    def _from_base(self, estimate: TargetEstimate, now: float) -> TargetEstimate | None:
        """The estimate as the head's base sees it; None if nobody knows where the base is."""
        if self._base is None:
            return estimate
        unknown = self._base.update()
        if unknown:
            self.machine.refused(f"nobody knows where the head is: {unknown}", now)
            return None
        base, upright = self._base, self._upright
        return TargetFromBase.of(
            estimate, self.head, lambda time: base.pose(time).rotation.inverse() @ upright, now
        )

    def _watch_servos(self, command: HeadCommand, joints: JointReading, now: float) -> None:
        goals, speeds = (command.pan, command.tilt), (command.pan_speed, command.tilt_speed)
        self.machine.stalled = stalled(self._stall_watches, goals, speeds, joints.positions, now)


@dataclass(frozen=True, slots=True)
class TargetFromBase(TargetEstimate):
    """A target as seen from the head's base, which turns.

    Attributes:
        head: the head on it.
        turn: how far the frame of the estimate is turned in the base frame at a time [s].
    """

    head: PanTiltHead
    turn: Callable[[float], Rotation]

    @staticmethod
    def of(
        estimate: TargetEstimate, head: PanTiltHead, turn: Callable[[float], Rotation], now: float
    ) -> TargetFromBase:
        """The same target, as seen from the base."""
        values = {field.name: getattr(estimate, field.name) for field in fields(estimate)}
        target = TargetFromBase(**values, head=head, turn=turn)
        return replace(target, sight=target.turned(estimate.sight, now))

    def turned(self, sight: Sight, time: float) -> Sight:
        """A sight in the frame of the estimate, in the base frame as it will be at a time [s]."""
        point = self.turn(time) @ self.head.point(sight)
        return self.head.sight(point, sight.pan, sight.tilt) or sight

    def sight_at(self, time: float) -> Sight:
        """Where the target is at a time [s], in the base frame as it will be then."""
        return self.turned(TargetEstimate.sight_at(self, time), time)

    def bearing(self, time: float) -> tuple[float, float]:
        """Pan and tilt that look at the target then [rad]."""
        pan, tilt, _ = self.sight_at(time)
        return pan, tilt

    def velocity(self, time: float) -> tuple[float, float]:
        """How they change [rad/s]."""
        before, after = self.bearing(time - _INSTANT), self.bearing(time + _INSTANT)
        pan, tilt = ((b - a) / (2.0 * _INSTANT) for a, b in zip(before, after, strict=True))
        return pan, tilt


def stalled(
    watches: Sequence[FollowingWatch],
    goals: Sequence[float],
    speeds: Sequence[float],
    positions: Sequence[float],
    now: float,
) -> str:
    """Which joints stand still although their goals are elsewhere, for a person; empty: none.

    Args:
        watches: of the joints.
        goals: of the newest commands [rad].
        speeds: of the newest commands [rad/s].
        positions: as measured [rad].
        now: the time [s].
    """
    standing = [
        watch.joint
        for watch, goal, speed, position in zip(watches, goals, speeds, positions, strict=True)
        if watch.check(goal, speed, position, now)
    ]
    return (
        f"{' and '.join(standing)} not moving to where told: relaxed, shut down or blocked?"
        if standing
        else ""
    )
