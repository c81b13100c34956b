"""One joint on its way: the motion it should make, and the commands that make the servo do it."""

from __future__ import annotations

import math

from head_tracking.tracking.joint_motion import JointMotion, MotionLimits
from head_tracking.tracking.rest import Rest, Wish
from head_tracking.tracking.servo_response import ServoResponse
from head_tracking.transforms import JointLimits

_RESERVE = 0.15  # s: so long a servo moves on if no other command comes
_MARGIN = 0.02  # rad
_SLOWEST = 1e-3  # rad/s; 0 would mean full speed to a servo
_REST_SPEED = 0.25  # rad/s
_ARRIVAL = 16.0  # 1/s: speed over the way that is left, where a joint stays
_ARRIVAL_SPEED = 0.3  # rad/s; the last bit of the way to where a joint stays
_ADRIFT = 0.1  # rad; a heavy shaft so far from its motion is elsewhere: it goes on from there
_SHOWN = 0.6  # of the acceleration that a servo has shown
_BRAKED = 0.25  # s in which a servo that accelerates no harder must be able to stop
_TURN = 0.02  # rad/s; slower motion does not change the side of the servo's dead band


class JointDrive:
    """Keeps one joint on a moving wish.

    Args:
        stamp: time of the first reading [s].
        position: that reading [rad].
        velocity: how the joint moves [rad/s].
        joint: its range.
        delay: from a command to the motion it causes, to start with [s].
    """

    def __init__(
        self, stamp: float, position: float, velocity: float, joint: JointLimits, delay: float
    ) -> None:
        self.servo = ServoResponse(stamp, position, velocity, delay)
        self.motion = JointMotion(joint.clamp(position), velocity)
        self._joint = joint
        self._rest = Rest()
        self._side = 0.0

    def measured(self, stamp: float, position: float, elapsed: float) -> None:
        """Takes a reading [s], [rad]; so much time has passed since the last command [s]."""
        self.motion.advance(elapsed)
        self.servo.measured(stamp, position)

    def follow(
        self,
        wish: Wish,
        now: float,
        period: float,
        late: float,
        limits: MotionLimits,
        dead_band: float,
        lead: float,
    ) -> tuple[float, float]:
        """The goal [rad] and the speed [rad/s] to command now.

        Args:
            wish: where the joint should be when the servo acts.
            now: the time [s].
            period: until the next command [s].
            late: how much later this servo acts [s].
            limits: how the joint may move.
            dead_band: at rest, errors below this are left alone [rad].
            lead: the farthest goal ahead [rad].
        """
        motion, servo, rest = self.motion, self.servo, self._rest
        shown = _SHOWN * servo.acceleration
        if shown < limits.acceleration:
            limits = MotionLimits(min(limits.speed, _BRAKED * shown), shown, limits.jerk)
        setpoint = servo.setpoint(now)
        off = wish.position - motion.position
        rest.judge(wish, off, motion.velocity, setpoint, dead_band, now)
        if rest.goal is not None:
            stamp, position = servo.reading
            rest.help(position, stamp, servo.resolution, dead_band)
            goal = self._joint.clamp(rest.goal)
            motion.rest_at(wish.position)
            servo.held(now, goal)
            return goal, min(_REST_SPEED, limits.speed)
        if servo.acceleration < math.inf and abs(setpoint - motion.position) > _ADRIFT:
            motion.position, motion.velocity = setpoint, servo.velocity
        motion.steer(wish.position, wish.velocity, period, limits, self._joint)
        arrival = self._arrival(wish, setpoint, now, period, limits, lead) if rest.near else None
        if arrival is not None:
            goal, speed = arrival
        else:
            speed = self._setpoint_speed(setpoint, period, late, limits)
            ahead = min(abs(speed) * (period + _RESERVE) + _MARGIN, lead)
            goal = self._joint.clamp(setpoint + math.copysign(ahead, speed))
        servo.commanded(now, speed, goal)
        return goal, max(abs(speed), _SLOWEST)

    def _arrival(
        self,
        wish: Wish,
        setpoint: float,
        now: float,
        period: float,
        limits: MotionLimits,
        lead: float,
    ) -> tuple[float, float] | None:
        """The goal and the signed speed for a wish that stands still: the servo itself stops there.

        None while the joint moves away from it, or is too far from it.
        """
        goal = self._joint.clamp(wish.position)
        left = abs(goal - self.servo.expected(now))
        # so fast that the joint, which moves on like this for the delay, can still brake
        lost = limits.acceleration * self.servo.delay
        braking = math.sqrt(lost * lost + 2.0 * limits.acceleration * left) - lost
        fast = max(_ARRIVAL_SPEED, min(_ARRIVAL * left, braking))
        way, last = goal - setpoint, self.servo.speed
        change = limits.acceleration * period
        away = last * way < 0.0 and abs(last) > change and abs(way) > abs(last) * period
        if away or abs(way) > lead:
            return None
        fast = min(fast, abs(last) + change, limits.speed)
        return goal, math.copysign(fast, way)

    def _setpoint_speed(
        self, setpoint: float, period: float, late: float, limits: MotionLimits
    ) -> float:
        """The speed at which the servo's setpoint must move for the motion."""
        motion, servo = self.motion, self.servo
        if abs(motion.velocity) > _TURN or self._side == 0.0:
            self._side = math.copysign(1.0, motion.velocity) if motion.velocity else 0.0
        end = motion.position + motion.velocity * (period + late) + self._side * servo.dead_band
        speed = (end - setpoint) / period
        return self._limited(speed, period, limits)

    def _limited(self, speed: float, period: float, limits: MotionLimits) -> float:
        """The nearest speed that the limits allow after the last one."""
        last, change = self.servo.speed, limits.acceleration * period
        if abs(last) > limits.speed:
            change = max(change, abs(last) - limits.speed)
        speed = min(max(speed, last - change), last + change)
        fastest = max(limits.speed, abs(last) - change)
        return min(max(speed, -fastest), fastest)
