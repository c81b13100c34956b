"""Keep a head on a moving target: target estimator, tracking law and state machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from head_tracking.gaze import HeadCommand, PanTiltHead, Ray
from head_tracking.tracking.estimator import (
    EstimatorParameters,
    TargetEstimate,
    TargetEstimator,
    Verdict,
)
from head_tracking.tracking.following import FollowingWatch, stalled
from head_tracking.tracking.head_camera import HeadCamera
from head_tracking.tracking.joint_readings import JointReading, JointReadings
from head_tracking.tracking.law import TrackingLaw
from head_tracking.tracking.learned import LearnedValue, Learning, LearningParameters
from head_tracking.tracking.target import HeadBase
from head_tracking.tracking.target_state import (
    TargetState,
    TargetStateMachine,
    TargetStateParameters,
)
from head_tracking.transforms import Rotation, Vector3

_SMOOTHING = 0.05  # weight of a new delay in the mean
_FAR_AHEAD = 1e6  # m; a ray to such a point is horizontal
CAUTIOUS_SPEED = 0.3
"""Speed limit after a stop, until the head is on its target [rad/s]."""
_JUMPS = 2  # points in a row; the next one usually confirms where a target has come back
_BY_STAMP = Verdict.FUTURE, Verdict.TOO_OLD
_REPORTED = *_BY_STAMP, Verdict.TOO_CLOSE  # also while a target is followed


@dataclass(frozen=True, slots=True)
class TrackingStep:
    """Result of one step of the tracker.

    Attributes:
        command: command for the joints; None: send nothing.
        error: angle between the measured pointing axis and the target at the time of that
            measurement [rad]; None without a target.
    """

    command: HeadCommand | None = None
    error: float | None = None


class Tracker:
    """Follow targets given in a fixed frame.

    Times are in seconds, on the clock of the stamps; it may be any clock.

    Args:
        head: the head to turn.
        law: the tracking law.
        base: pose of the head's base frame; None: targets are given in the base frame.
        readings: history of the joints, if another object measures them; None: `joints_read` does.

    Attributes:
        head: as given.
        law: may be replaced at any time.
        machine: the state machine.
        camera: the estimates of a camera on the head; its `fault` ends tracking until `restart`.
        message_age: mean age of a point at arrival [s].
        interval: mean time between points [s].
        reading_age: mean age of a joint reading when it is used [s].
    """

    def __init__(
        self,
        head: PanTiltHead,
        law: TrackingLaw,
        base: HeadBase | None = None,
        readings: JointReadings | None = None,
    ) -> None:
        self.head = head
        self.law = law
        ahead = head.ray((_FAR_AHEAD, 0.0, 0.0), 0.0, 0.0)
        level = 0.0 if ahead is None else ahead.tilt
        self.estimator = TargetEstimator(EstimatorParameters(), level)
        self.machine = TargetStateMachine(head, TargetStateParameters())
        self._base = base
        self._stall_watches = {
            joint: FollowingWatch() for joint in (head.pan_joint, head.tilt_joint)
        }
        self._readings = JointReadings() if readings is None else readings
        self.camera = HeadCamera(head, self._readings, base)
        self._upright = Rotation.identity()
        self.message_age = self.interval = self.reading_age = 0.0
        self._jumps = 0
        self._came: float | None = None

    @property
    def state(self) -> TargetState:
        """The present state."""
        return self.machine.state

    @property
    def learned(self) -> Mapping[str, LearnedValue]:
        """Estimates of the servos and of a camera on the head, by name."""
        return {**self.law.learned, "camera: its stamps are too late by": self.camera.learned}

    def learn(self, parameters: LearningParameters) -> None:
        """Update, freeze, discard or replace the estimates."""
        self.camera.parameters = parameters
        self.law.learn(parameters)
        if parameters.camera_learning == Learning.FORGET:
            self.camera.forget()

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """Accept pan and tilt [rad] measured at `stamp` [s]; ignore older or not finite ones."""
        self._readings.append(stamp, positions)

    def target_seen(
        self, stamp: float, point: Vector3, now: float, *, moving: bool = False
    ) -> Verdict:
        """Accept a point and return the result.

        Args:
            stamp: when the target was there [s].
            point: shape (3,) [m], in the fixed frame.
            now: the time [s].
            moving: whether the sensor moves with the head.
        """
        if self.camera.fault:
            return Verdict.IGNORED
        came = now
        if moving and self._readings.latest is not None:
            corrected, point = self.camera.corrected(stamp, point)
            came += corrected - stamp  # a correction, which may be wrong, makes no point too old
            stamp = corrected
        verdict = self._add(stamp, point, came, is_unsure=moving and self.camera.is_unsure)
        if verdict.used:
            new = verdict is Verdict.NEW_TARGET
            self.machine.seen(now, new=new)
            self.message_age += (1.0 if new else _SMOOTHING) * (now - stamp - self.message_age)
            if self._came is not None and not new:
                self.interval += _SMOOTHING * (now - self._came - self.interval)
            self._came, self._jumps = now, 0
        elif verdict in _REPORTED or not self._follows(now):
            self._jumps += verdict is Verdict.JUMP
            if verdict is not Verdict.JUMP or self._jumps > _JUMPS:
                age = f": {abs(came - stamp):.3g} s" if verdict in _BY_STAMP else ""
                self.machine.refused(f"{verdict}{age}", now)
        return verdict

    def _add(self, stamp: float, point: Vector3, now: float, *, is_unsure: bool) -> Verdict:
        """Pass a point in the fixed frame to the estimator."""
        estimate, latest = self.estimator.estimate, self._readings.latest
        if estimate is not None:
            pan, tilt, _ = estimate.ray
        else:
            pan, tilt = latest.positions if latest is not None else (0.0, 0.0)
        if self._base is not None:
            place = self._base.at(stamp)
            if estimate is None:
                self._upright = place.rotation
            x, y, z = (a - b for a, b in zip(point, place.translation, strict=True))
            point = self._upright.inverse() @ (x, y, z)
        ray = self.head.ray(point, pan, tilt)
        if ray is None:
            return Verdict.TOO_CLOSE
        return self.estimator.add(stamp, ray, now, is_unsure=is_unsure)

    def step(self, now: float) -> TrackingStep:
        """Return the command for now; none before the joints were measured."""
        joints = self._readings.latest
        if joints is None:
            return TrackingStep()
        again = self.camera.update(self.estimator.rate)
        if again:
            self.estimator.reset()  # its points had wrong stamps
            for stamp, point in again:
                self._add(stamp, point, stamp, is_unsure=self.camera.is_unsure)
            self.machine.seen(now, new=False)
        if self.camera.fault:
            return TrackingStep(self._halt(self.camera.fault))
        if self.estimator.settle(now, is_lost=not self._follows(now)):
            self.machine.seen(now, new=True)
            self._came, self._jumps = now, 0
        self.reading_age += _SMOOTHING * (now - joints.stamp - self.reading_age)
        estimate = self.estimator.estimate
        if estimate is not None and self._follows(now):
            if self.machine.state is TargetState.COASTING:
                estimate = self.estimator.in_view()
            target = self._from_base(estimate, now)
            if target is None:
                return TrackingStep()
            command, gaze = self.law.follow(target, joints, now)
            there = self.head.point(target.ray_at(joints.stamp))
            error = self.head.miss(there, *joints.positions)
            self.machine.followed(gaze, error, now)
            ahead = self.message_age + 0.5 * self.interval + 0.5 * sum(self.law.lead_times)
            self.estimator.lead_time += _SMOOTHING * (ahead - self.estimator.lead_time)
            self._watch_servos(command, joints)
            return TrackingStep(command, error)
        goal = self.machine.goal(joints.positions, lambda: self._waiting(joints, now), now)
        if goal is None:
            return TrackingStep()
        speed = min(self.machine.parameters.default_joint_speed, self.law.at_most)
        command = self.law.go_to(goal, speed, joints, now)
        self._watch_servos(command, joints)
        return TrackingStep(command)

    def restart(self) -> HeadCommand | None:
        """Discard the target, and a fault of the camera.

        Returns:
            The command that stops the head at the measured position; None if it does not move.
        """
        command = self._halt("no target has come since tracking began")
        if self.camera.fault:
            self.camera.forget()
        return command

    def recenter(self) -> None:
        """Discard the target and turn both joints to 0, or to the limit next to it."""
        self.estimator.reset()
        self.camera.forget_target()
        self.machine.recenter()

    def reset(self, reason: str) -> HeadCommand | None:
        """Discard joint readings, target and delays, as after a jump of the clock.

        Args:
            reason: reason, for the state.

        Returns:
            The command that stops the head at the measured position; None if it does not move.
        """
        command = self._halt(f"{reason}; no target has come since")
        self._readings.clear()
        self.message_age = self.interval = self.reading_age = 0.0
        self._came = None
        self.camera.restart()
        return command

    def _halt(self, reason: str) -> HeadCommand | None:
        """Discard the target; return the command that stops the head, if it moves."""
        moving = self.state is not TargetState.IDLE
        self.estimator.reset()
        self.camera.forget_target()
        self.machine.forget(reason)
        command = self._stop()
        return command if moving else None

    def _follows(self, now: float) -> bool:
        return self.machine.follows(now, self.estimator.parameters.target_timeout)

    def _stop(self) -> HeadCommand | None:
        for watch in self._stall_watches.values():
            watch.restart()
        joints = self._readings.latest
        return None if joints is None else self.law.stop(joints)

    def _waiting(self, joints: JointReading, now: float) -> tuple[float, float] | None:
        """Return pan and tilt that look at where a lost target may be [rad]; None: unknown."""
        if self.estimator.estimate is None:
            return None
        estimate = self._from_base(self.estimator.in_view(), now)
        if estimate is None:
            return None
        gaze = self.head.gaze_along(estimate.ray_at(now), *joints.positions)
        return gaze.pan, gaze.tilt

    def _from_base(self, estimate: TargetEstimate, now: float) -> TargetEstimate | None:
        """Return the estimate in the base frame; None if the pose of the base is unknown."""
        if self._base is None:
            return estimate
        unknown = self._base.update()
        if unknown:
            self.machine.refused(f"the pose of the head is unknown: {unknown}", now)
            return None
        return replace(estimate, ray=self._turned(estimate.ray, now), turned=self._turned)

    def _turned(self, ray: Ray, time: float) -> Ray:
        """Transform a ray of the estimator into the base frame at a time [s]."""
        assert self._base is not None
        turn = self._base.pose(time).rotation.inverse() @ self._upright
        return self.head.ray(turn @ self.head.point(ray), ray.pan, ray.tilt) or ray

    def _watch_servos(self, command: HeadCommand, joints: JointReading) -> None:
        self.machine.stalled = stalled(
            self._stall_watches,
            (command.pan, command.tilt),
            (command.pan_speed, command.tilt_speed),
            joints.positions,
            joints.stamp,
        )
