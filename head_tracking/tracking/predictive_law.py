"""The predictive law: the head moves now as the target will move when the servos act."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from head_tracking.gaze import Gaze, GazeStatus, HeadCommand, PanTiltHead
from head_tracking.tracking.estimator import TargetEstimate
from head_tracking.tracking.joint_drive import JointDrive
from head_tracking.tracking.joint_motion import MotionLimits
from head_tracking.tracking.law import JointReading, inside
from head_tracking.tracking.law_parameters import LawParameters
from head_tracking.tracking.rest import Wish
from head_tracking.transforms import JointLimits

USUAL_SPEED = 5.0  # rad/s

_USUAL_DELAY = 0.04  # s, until the servos have shown their own
_LONGEST_PAUSE = 0.2  # s; after a longer one the law starts anew
_BUILD_UP = 0.02  # s; an acceleration that takes longer to build up cannot be braked with
_MOVING = 0.15  # rad/s
_EDGE = 0.05  # rad; so far inside the far end of its range a target must be to be followed there


class PredictiveLaw:
    """Feeds the target's motion forward, through the exact gaze, to where and when it is needed.

    A joint is steered in three steps: where it should be when the servo acts (gaze at the
    predicted target), how it gets there within its limits (`JointMotion`), and at which speed the
    servo's setpoint must move for that (`ServoResponse`). Commands stay speeds with a goal ahead.

    Args:
        head: the head to steer.
        period: time between two commands [s].
        parameters: of the laws.

    Attributes:
        parameters: may change at any time.
    """

    def __init__(self, head: PanTiltHead, period: float, parameters: LawParameters) -> None:
        self.parameters = parameters
        self._head = head
        self._period = period
        self._drives: tuple[JointDrive, JointDrive] | None = None
        self._known_delays = (_USUAL_DELAY, _USUAL_DELAY)
        self._known_accelerations = (math.inf, math.inf)
        self._mean_delay = _USUAL_DELAY
        self._stepped = 0.0
        self._path: _Path | None = None

    @property
    def horizon(self) -> float:
        """See `TrackingLaw`."""
        return self._mean_delay + self._period

    @property
    def delays(self) -> tuple[float, float]:
        """See `TrackingLaw`."""
        if self.parameters.predictive.servo_delay > 0.0:
            return self.parameters.predictive.servo_delay, self.parameters.predictive.servo_delay
        if self._drives is not None:
            pan, tilt = self._drives
            self._known_delays = pan.servo.delay, tilt.servo.delay
        return self._known_delays

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        pan, tilt = self._take(joints, now)
        start = now + self._mean_delay
        end = start + self._period
        near = pan.motion.position, tilt.motion.position
        gaze = self._gaze(target, end, near)
        wanted = None if self._path is None else self._path.at(start, target)
        if wanted is None:
            before = self._gaze(target, start, near)
            wanted = before.pan, before.tilt
        self._path = _Path(target, start, wanted, end, (gaze.pan, gaze.tilt))
        here, there = self._path.start_positions, self._path.end_positions
        velocities = [(b - a) / self._period for a, b in zip(here, there, strict=True)]
        moving = max(map(abs, velocities)) > _MOVING  # one joint alone does not come to rest early
        wishes = [
            Wish(
                position,
                velocity,
                0.0 if moving else target.deviation(joint, start),
                0.0 if moving else target.speed_deviation(joint),
            )
            for joint, (position, velocity) in enumerate(zip(here, velocities, strict=True))
        ]
        return self._steer(wishes, self.parameters.limits.speed(USUAL_SPEED), now), gaze

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """See `TrackingLaw`."""
        self._take(joints, now)
        self._path = None
        return self._steer([Wish(position) for position in goal], speed, now)

    def stop(self, joints: JointReading, now: float) -> HeadCommand:
        """See `TrackingLaw`."""
        self._drives = self._path = None
        speed = self.parameters.limits.speed(USUAL_SPEED)
        return HeadCommand(*inside(self._head, joints.positions), speed, speed)

    def _take(self, joints: JointReading, now: float) -> tuple[JointDrive, JointDrive]:
        """The joints, told of the newest reading; new ones after a pause."""
        delays, elapsed = self.delays, now - self._stepped
        pause = max(_LONGEST_PAUSE, 3.0 * self._period)
        if self._drives is None or not 0.0 <= elapsed <= pause:
            self._path, elapsed = None, 0.0
            head = self._head
            self._drives = (
                self._drive(joints, 0, delays[0], head.pan_limits),
                self._drive(joints, 1, delays[1], head.tilt_limits),
            )
            for drive, known in zip(self._drives, self._known_accelerations, strict=True):
                drive.servo.acceleration = known
        for drive, position, delay in zip(self._drives, joints.positions, delays, strict=True):
            drive.servo.learning = self.parameters.predictive.servo_delay == 0.0
            drive.servo.delay = delay
            drive.measured(joints.stamp, position, elapsed)
        self._mean_delay = 0.5 * sum(self.delays)
        self._known_accelerations = (
            self._drives[0].servo.acceleration,
            self._drives[1].servo.acceleration,
        )
        self._stepped = now
        return self._drives

    @staticmethod
    def _drive(joints: JointReading, index: int, delay: float, limits: JointLimits) -> JointDrive:
        position, velocity = joints.positions[index], joints.velocities[index]
        return JointDrive(joints.stamp, position, velocity, limits, delay)

    def _gaze(self, target: TargetEstimate, time: float, near: tuple[float, float]) -> Gaze:
        """The gaze at the predicted target.

        A target that comes into reach at the far end of the range is not followed there, all the
        way round, before it is well inside: it may be gone again at once.
        """
        gaze = self._head.look(target.sight_at(time), *near)
        if self._path is None:
            return gaze
        pan, tilt = self._path.end_positions
        limits = self._head.pan_limits
        inside = min(limits.upper - gaze.pan, gaze.pan - limits.lower)
        if abs(gaze.pan - pan) < math.pi or inside > _EDGE:
            return gaze
        reason = f"the target has just come into reach at the other end, at pan {gaze.pan:.2f} rad"
        return replace(gaze, pan=pan, tilt=tilt, status=GazeStatus.OUT_OF_REACH, reason=reason)

    def _steer(self, wishes: Sequence[Wish], speed: float, now: float) -> HeadCommand:
        assert self._drives is not None
        p = self.parameters.predictive
        acceleration = min(p.max_joint_acceleration, _BUILD_UP * p.max_joint_jerk)
        limits = (self._head.pan_limits, self._head.tilt_limits)
        (pan, pan_speed), (tilt, tilt_speed) = (
            drive.follow(
                wish,
                now,
                self._period,
                drive.servo.delay - self._mean_delay,
                MotionLimits(min(speed, joint.velocity), acceleration, p.max_joint_jerk),
                p.dead_band,
                self.parameters.limits.lead_target_angle,
            )
            for drive, wish, joint in zip(self._drives, wishes, limits, strict=True)
        )
        return HeadCommand(pan, tilt, pan_speed, tilt_speed)


@dataclass(frozen=True, slots=True)
class _Path:
    """Where the joints should be at the start and at the end of one period.

    The next period starts where this one ended, unless more is known of the target by then.
    """

    target: TargetEstimate
    start: float
    start_positions: tuple[float, float]
    end: float
    end_positions: tuple[float, float]

    def at(self, time: float, target: TargetEstimate) -> tuple[float, float] | None:
        """Pan and tilt [rad] at a time near the end [s]; None if the target is known better."""
        if target is not self.target:
            return None
        ratio = (time - self.start) / (self.end - self.start)
        (pan, tilt), (next_pan, next_tilt) = self.start_positions, self.end_positions
        return pan + ratio * (next_pan - pan), tilt + ratio * (next_tilt - tilt)
