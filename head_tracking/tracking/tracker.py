"""Keeps a head on a moving target: estimate, tracking law and the target's life together."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from head_tracking.gaze import Gaze, HeadCommand, PanTiltHead, Sight
from head_tracking.tracking.estimator import EstimatorParameters, TargetEstimator, Verdict
from head_tracking.tracking.law import JointReading, TrackingLaw
from head_tracking.tracking.life_cycle import LifeCycle, LifeCycleParameters, TargetState
from head_tracking.tracking.stamp_error import StampError
from head_tracking.transforms import Vector3

_VELOCITY_WINDOW = 0.06  # s
_SMOOTHING = 0.05  # of a delay, from one step to the next


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
    """

    message: float
    interval: float
    reading: float
    servos: tuple[float, float]


class Tracker:
    """Follows targets given in the head's base frame.

    Times are in seconds, on the clock of the stamps; it may be any clock.

    Args:
        head: the head to turn.
        law: steers it.
        estimator: what counts as the same target.
        life_cycle: what to do without one.

    Attributes:
        head: the head that is turned.
        law: may be changed for another one at any time.
    """

    def __init__(
        self,
        head: PanTiltHead,
        law: TrackingLaw,
        estimator: EstimatorParameters,
        life_cycle: LifeCycleParameters,
    ) -> None:
        self.head = head
        self.law = law
        self.estimator = TargetEstimator(estimator)
        self.life_cycle = LifeCycle(head, life_cycle)
        self._readings: deque[JointReading] = deque()
        self.stamp_error = StampError()
        self._seen: deque[tuple[float, Sight]] = deque()
        self._message_age = self._reading_age = 0.0
        self._interval = 0.0
        self._came: float | None = None

    @property
    def state(self) -> TargetState:
        """What the head is doing about its target."""
        return self.life_cycle.state

    @property
    def delays(self) -> Delays:
        """How late everything is, as measured."""
        return Delays(self._message_age, self._interval, self._reading_age, self.law.delays)

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

    def target_seen(
        self, stamp: float, point: Vector3, now: float, *, moving: bool = False
    ) -> Verdict:
        """Takes a point, shape (3,) [m], in the head's base frame, seen at `stamp` [s]."""
        if not self.life_cycle.enabled:
            return Verdict.IGNORED
        near = self.estimator.estimate
        if near is not None:
            pan, tilt = near.sight.pan, near.sight.tilt
        else:
            pan, tilt = self._readings[-1].positions if self._readings else (0.0, 0.0)
        sight = self.head.sight(point, pan, tilt)
        if sight is None:
            return Verdict.TOO_CLOSE
        if moving:
            sight, stamp = self._unerring(stamp, sight), stamp - self.stamp_error.value
        verdict = self.estimator.add(stamp, sight, now)
        if verdict.used:
            new = verdict is Verdict.NEW_TARGET
            self.life_cycle.seen(now, new=new)
            self._message_age += (1.0 if new else _SMOOTHING) * (now - stamp - self._message_age)
            if self._came is not None and not new:
                self._interval += _SMOOTHING * (now - self._came - self._interval)
            self._came = now
        return verdict

    def _unerring(self, stamp: float, sight: Sight) -> Sight:
        """A point of a camera on the head as it is without its stamp's error."""
        error = self.stamp_error
        self._seen.append((stamp, sight))
        while self._seen[0][0] < stamp - 1.0:
            self._seen.popleft()
        if error.point_seen(stamp, sight):
            earlier = sorted(self._seen)[:-1]
            self.estimator.replay(
                [(then - error.value, error.corrected(then, seen)) for then, seen in earlier]
            )
        return error.corrected(stamp, sight)

    def step(self, now: float) -> TrackingStep:
        """What to do now; nothing before the joints were read."""
        if not self._readings or not self.life_cycle.enabled:
            return TrackingStep()
        joints = self._readings[-1]
        self._reading_age += _SMOOTHING * (now - joints.stamp - self._reading_age)
        estimate = self.estimator.estimate
        if estimate is not None and self.life_cycle.follows(
            now, self.estimator.parameters.target_timeout
        ):
            command, gaze = self.law.follow(estimate, joints, now)
            there = self.head.point(estimate.sight_at(joints.stamp))
            error = self.head.miss(there, *joints.positions)
            self.life_cycle.followed(gaze, error, now)
            ahead = self._message_age + 0.5 * self._interval + self.law.horizon
            self.estimator.horizon += _SMOOTHING * (ahead - self.estimator.horizon)
            return TrackingStep(command, gaze, error)
        goal = self.life_cycle.goal(joints.positions, now)
        if goal is None:
            return TrackingStep()
        speed = self.life_cycle.parameters.default_joint_speed
        return TrackingStep(self.law.go_to(goal, speed, joints, now))

    def enable(self, on: bool, now: float) -> HeadCommand | None:
        """Follows targets from now on, or stops the head at once; the command for that."""
        self.estimator.reset()
        self.life_cycle.enable(on)
        return None if on else self._stop(now)

    def recenter(self) -> None:
        """Forgets the target and takes both joints to 0 or the limit next to it."""
        self.estimator.reset()
        self.life_cycle.recenter()

    def _stop(self, now: float) -> HeadCommand | None:
        return self.law.stop(self._readings[-1], now) if self._readings else None
