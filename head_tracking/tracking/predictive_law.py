"""The predictive law: the head moves now as the target will move when the servos act."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from head_tracking.gaze import Gaze, HeadCommand, PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.tracking.joint_motion import JointMotion, MotionLimits
from head_tracking.tracking.law import JointReading
from head_tracking.tracking.rest import Rest
from head_tracking.tracking.servo_response import ServoResponse
from head_tracking.tracking.speed_law import SpeedLawParameters
from head_tracking.tracking.target_estimate import TargetEstimate
from head_tracking.transforms import JointLimits

_LONGEST_PAUSE = 0.2  # s; after a longer one the law starts anew
_RESERVE = 0.15  # s: so long a servo moves on if no other command comes
_MARGIN = 0.02  # rad
_SLOWEST = 1e-3  # rad/s; 0 would mean full speed to a servo


@dataclass(frozen=True, slots=True)
class PredictiveLawParameters:
    """How calmly the head moves."""

    max_joint_acceleration: float = parameter(
        50.0, "Hardest acceleration.", unit="rad/s^2", minimum=1.0, maximum=500.0
    )
    max_joint_jerk: float = parameter(
        3000.0, "Hardest change of acceleration.", unit="rad/s^3", minimum=10.0, maximum=1e5
    )
    dead_band: float = parameter(
        0.004,
        "At rest, errors below this are left alone.",
        unit="rad",
        minimum=0.0,
        maximum=0.1,
    )
    servo_delay: float = parameter(
        0.0,
        "From a command to the motion it causes; 0: measured while the head moves.",
        unit="s",
        minimum=0.0,
        maximum=0.3,
    )


class PredictiveLaw:
    """Feeds the target's motion forward, through the exact gaze, to where and when it is needed.

    A joint is steered in three steps: where it should be when the servo acts (gaze at the
    predicted target), how it gets there within its limits (`JointMotion`), and at which speed the
    servo's setpoint must move for that (`ServoResponse`). Commands stay speeds with a goal ahead.

    Args:
        head: the head to steer.
        tutorial: of these the speed limit and the lead are used.
        parameters: the law's own.
        period: time between two commands [s].
    """

    def __init__(
        self,
        head: PanTiltHead,
        tutorial: SpeedLawParameters,
        parameters: PredictiveLawParameters,
        period: float,
    ) -> None:
        self._head = head
        self.tutorial = tutorial
        self.parameters = parameters
        self._period = period
        self._joints: tuple[_Joint, _Joint] | None = None
        self._stepped = 0.0
        self._gaze_now: tuple[float, float] | None = None
        self._followed: TargetEstimate | None = None
        self._knots: _Knots | None = None

    @property
    def horizon(self) -> float:
        """From now to the end of the motion that the next command causes [s]."""
        return self._delay + self._period

    @property
    def _delay(self) -> float:
        if self._joints is None:
            return 0.04
        return 0.5 * sum(joint.servo.delay for joint in self._joints)

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        pan, tilt = self._take(joints, now)
        acting, dt = now + self._delay, self._period
        near = pan.motion.position, tilt.motion.position
        gaze = self._head.gaze(target.position(acting + dt), *near)
        goal = gaze.pan, gaze.tilt
        if target is not self._followed or self._knots is None:
            before = self._head.gaze(target.position(acting), *near)
            wanted = before.pan, before.tilt
        else:
            wanted = self._knots.at(acting)
        self._followed = target
        self._knots = _Knots(acting, wanted, acting + dt, goal)
        distance = max(math.hypot(*target.point), 1e-3)
        noise = target.deviation(acting) / distance
        speed_noise = target.speed_deviation / distance
        return self._steer(wanted, goal, self.tutorial.max_joint_speed, now, noise, speed_noise), gaze

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """See `TrackingLaw`."""
        self._take(joints, now)
        self._followed = self._knots = None
        return self._steer(goal, goal, speed, now, 0.0, 0.0)

    def stop(self, joints: JointReading, now: float) -> HeadCommand:
        """See `TrackingLaw`."""
        self._joints = None
        fast = self.tutorial.max_joint_speed
        return HeadCommand(*joints.positions, fast, fast)

    def _take(self, reading: JointReading, now: float) -> tuple[_Joint, _Joint]:
        """The joints, told of the newest reading; new ones after a pause."""
        if self._joints is None or not 0.0 <= now - self._stepped <= _LONGEST_PAUSE:
            self._followed = self._knots = None
            known = [] if self._joints is None else [joint.servo.delay for joint in self._joints]
            self._joints = tuple(
                _Joint(reading.stamp, position, limits)
                for position, limits in zip(
                    reading.positions, (self._head.pan_limits, self._head.tilt_limits), strict=True
                )
            )
            for joint, delay in zip(self._joints, known):
                joint.servo.delay = delay
            self._stepped = now
        for joint, position in zip(self._joints, reading.positions, strict=True):
            joint.motion.advance(now - self._stepped)
            joint.servo.measured(reading.stamp, position)
        self._stepped = now
        return self._joints

    def _steer(self, wanted, goal, speed, now, noise, speed_noise):
        p = self.parameters
        commands = []
        for joint, here, there in zip(self._joints, wanted, goal, strict=True):
            limits = MotionLimits(
                min(speed, joint.limits.velocity), p.max_joint_acceleration, p.max_joint_jerk
            )
            late = joint.servo.delay - self._delay
            commands.append(
                joint.step(
                    here, there, now, self._period, limits, p.dead_band, noise, speed_noise, late,
                    self.tutorial.lead_target_angle,
                )
            )
        (pan, pan_speed), (tilt, tilt_speed) = commands
        return HeadCommand(pan, tilt, pan_speed, tilt_speed)


@dataclass(frozen=True, slots=True)
class _Knots:
    t0: float
    p0: tuple[float, float]
    t1: float
    p1: tuple[float, float]

    def at(self, t):
        r = (t - self.t0) / (self.t1 - self.t0)
        return tuple(a + r * (b - a) for a, b in zip(self.p0, self.p1, strict=True))


class _Joint:
    def __init__(self, stamp: float, position: float, limits: JointLimits) -> None:
        self.limits = limits
        self.motion = JointMotion(limits.clamp(position))
        self.servo = ServoResponse(stamp, position)
        self.rest = Rest()
        self._side = 0.0

    def step(self, here, there, now, dt, limits, dead_band, noise, speed_noise, late, lead):
        velocity = (there - here) / dt
        stays = self.rest.update(here, velocity, self.motion, self.servo, now, dead_band, noise, speed_noise)
        if stays is not None:
            self.motion.position, self.motion.velocity = here, 0.0
            self.motion._acceleration = 0.; self.motion._wanted_velocity = 0.
            goal = self.limits.clamp(stays)
            self.servo.held(now, goal)
            return goal, REST_SPEED
        self.motion.steer(here, velocity, dt, limits, self.limits)
        v = self.motion.velocity
        if abs(v) > TURN:
            self._side = math.copysign(1.0, v)
        elif self._side == 0.0 and v: self._side = math.copysign(1.0, v)
        target = self.motion.position + v * (dt + late) + self._side * self.servo.dead_band
        speed = (target - self.servo.setpoint(now)) / dt
        last = self.servo.speed
        change = limits.acceleration * dt
        speed = min(max(speed, last - change), last + change)
        speed = min(max(speed, -limits.speed), limits.speed)
        self.servo.commanded(now, speed)
        ahead = min(abs(speed) * (dt + _RESERVE) + _MARGIN, lead)
        goal = self.limits.clamp(self.servo.setpoint(now) + math.copysign(ahead, speed))
        return goal, max(abs(speed), _SLOWEST)

TURN = 0.02
REST_SPEED = 0.25
