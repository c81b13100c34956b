"""One joint: the motion that takes it to its reference, its rest, and its servo's commands."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.tracking.servo_model import ServoModel
from head_tracking.transforms import JointLimits

_RESPONSE = 25.0  # 1/s: how fast a deviation from what is wanted is made up
_BRAKING = 0.6  # share of the acceleration used to plan where to brake
_LEAST_BRAKING = 0.05
_NEED_TIME = 0.3  # s
_COPIED = 0.4  # of the acceleration: with less to spare than this a motion is copied in part


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """How a joint may move.

    Attributes:
        speed: [rad/s].
        acceleration: [rad/s^2].
        jerk: [rad/s^3].
    """

    speed: float
    acceleration: float
    jerk: float


class JointMotion:
    """Follows a wanted position that itself moves, without lag, and comes to jumps smoothly.

    A wanted motion that the limits allow is copied; a jump in it is made up as by a critically
    damped spring, and a long way at a speed from which the joint can brake in time.

    Args:
        position: where the joint stands [rad].
        velocity: how it moves [rad/s].

    Attributes:
        position: where the joint is meant to be [rad].
        velocity: how it is meant to move [rad/s].
    """

    def __init__(self, position: float, velocity: float = 0.0) -> None:
        self.position = position
        self.velocity = velocity
        self._acceleration = 0.0
        self._wanted_velocity = velocity
        self._asked_velocity = velocity
        self._need = 0.0

    def advance(self, dt: float) -> None:
        """Time passes [s]."""
        self.position += self.velocity * dt

    def rest_at(self, position: float) -> None:
        """The joint stands still [rad]."""
        self.position = position
        self.velocity = self._acceleration = self._wanted_velocity = self._asked_velocity = 0.0

    def steer(
        self, wanted: float, velocity: float, dt: float, limits: MotionLimits, joint: JointLimits
    ) -> None:
        """Chooses the velocity for the next `dt` [s].

        Args:
            wanted: where the joint should be now [rad].
            velocity: how it should move in the time `dt` [rad/s].
            dt: until the next choice [s].
            limits: how the joint may move.
            joint: its range, which is never left.
        """
        remaining = math.exp(-_RESPONSE * dt)
        # gains that put both poles of the sampled loop at `remaining`
        stiffness = (1.0 - remaining) ** 2 / (dt * dt)
        damping = (3.0 - 2.0 * remaining - remaining**2) / (2.0 * dt)
        error = wanted - self.position
        share = min(1.0, dt / _NEED_TIME)
        self._need += share * (abs(velocity - self._asked_velocity) / dt - self._need)
        self._asked_velocity = velocity
        # what the joint cannot follow it does not copy: it goes where the target is, as it can
        copied = min(max((1.0 - self._need / limits.acceleration) / _COPIED, 0.0), 1.0)
        closing = self._closing_speed(error, stiffness / damping, copied * self._need, limits)
        velocity *= copied
        needed = (velocity - self._wanted_velocity) / dt
        asked = needed
        asked += damping * (closing + self._wanted_velocity - self.velocity)
        self._wanted_velocity = velocity
        change = limits.jerk * dt
        acceleration = min(max(asked, self._acceleration - change), self._acceleration + change)
        acceleration = min(max(acceleration, -limits.acceleration), limits.acceleration)
        chosen = self.velocity + acceleration * dt
        fastest = max(limits.speed, abs(self.velocity) - limits.acceleration * dt)
        chosen = min(max(chosen, -fastest), fastest)
        chosen = self._inside(chosen, dt, limits, joint)
        self._acceleration = (chosen - self.velocity) / dt
        self.velocity = chosen

    def _closing_speed(self, error: float, gain: float, need: float, limits: MotionLimits) -> float:
        """The speed at which to make up an error: proportional, but one that can be braked."""
        spare = limits.acceleration - min(need, limits.acceleration)
        braking = max(_BRAKING * spare, _LEAST_BRAKING * limits.acceleration)
        linear = braking / gain**2  # where the two meet with the same slope
        if abs(error) <= linear:
            return gain * error
        return math.copysign(math.sqrt(braking * (2.0 * abs(error) - linear)), error)

    def _inside(
        self, velocity: float, dt: float, limits: MotionLimits, joint: JointLimits
    ) -> float:
        """The velocity, reduced so that the joint stops at the end of its range."""
        room = joint.upper - self.position if velocity > 0.0 else self.position - joint.lower
        if not math.isfinite(room):
            return velocity
        room = max(0.0, room)
        a = _BRAKING * limits.acceleration
        fastest = a * (math.sqrt(dt * dt + 2.0 * room / a) - dt)
        return min(max(velocity, -fastest), fastest)


_CALM = 0.1  # s; for so long a joint must have been where it should be
_SETTLED = 0.2  # s after which a joint that stopped short is helped
_AIM = 1.0  # s; over which the place of a joint at rest is averaged, and aimed at again
_SLOW = 0.015  # rad/s; a target slower than this may be one that stands still
_FARTHEST_HELP = 3.0  # resolutions of the encoder


@dataclass(frozen=True, slots=True)
class Reference:
    """Where a joint should be.

    Attributes:
        position: [rad].
        velocity: [rad/s].
        noise: standard deviation of that position [rad].
        speed_noise: standard deviation of that velocity [rad/s].
    """

    position: float
    velocity: float = 0.0
    noise: float = 0.0
    speed_noise: float = 0.0


class Rest:
    """A dead band with hysteresis: easy to stay in, harder to come into.

    Attributes:
        goal: where the joint rests [rad]; None while it moves.
        near: whether the joint is wanted where it may come to rest.
    """

    def __init__(self) -> None:
        self.goal: float | None = None
        self.near = False
        self._place = 0.0
        self._calm_since: float | None = None
        self._mean = 0.0
        self._helped = self._aimed = self._judged = 0.0

    def wake(self) -> None:
        """The joint moves."""
        self.goal = self._calm_since = None

    def judge(
        self,
        reference: Reference,
        off: float,
        speed: float,
        setpoint: float,
        dead_band: float,
        now: float,
    ) -> None:
        """Decides whether the joint rests.

        Args:
            reference: where it should be.
            off: by how much its intended motion is not there [rad].
            speed: of its intended motion [rad/s].
            setpoint: where the servo would stay if it were told nothing any more [rad].
            dead_band: errors below this are left alone [rad].
            now: the time [s].
        """
        band = max(dead_band, min(3.0 * reference.noise, 4.0 * dead_band))
        slow = min(max(2.0 * reference.speed_noise, _SLOW), 4.0 * _SLOW)
        self.near = abs(reference.velocity) <= slow
        if self.goal is not None:
            if abs(reference.position - self._place) > band or abs(reference.velocity) > 2.5 * slow:
                self.wake()
                return
            self._mean += min((now - self._judged) / _AIM, 1.0) * (reference.position - self._mean)
            self._judged = now
            off = self._mean - self._place
            if abs(off) > 0.5 * dead_band and now - self._aimed >= _AIM:
                self.goal += off
                self._place, self._aimed = self._mean, now
            return
        if not self.near or abs(speed) > slow or abs(off) > 0.5 * band:
            self._calm_since = None
            return
        if self._calm_since is None:
            self._calm_since = now
        if now - self._calm_since >= _CALM:
            self.goal, self._place = setpoint, reference.position
            self._mean = reference.position
            self._helped = self._aimed = self._judged = now

    def help(self, measured: float, stamp: float, resolution: float, dead_band: float) -> None:
        """Moves the goal of a joint that came to rest beside its place.

        Args:
            measured: where it stands [rad].
            stamp: when that was [s].
            resolution: of its encoder [rad].
            dead_band: errors below this are left alone [rad].
        """
        short = self._place - measured
        if self.goal is None or abs(short) <= max(dead_band, 0.75 * resolution):
            return
        if stamp - self._helped >= _SETTLED:
            self._helped = stamp
            farthest = _FARTHEST_HELP * resolution
            ahead = self.goal - self._place + short
            if ahead * short < 0.0:
                ahead = math.copysign(resolution, short)
            self.goal = self._place + min(max(ahead, -farthest), farthest)


_RESERVE = 0.15  # s: so long a servo moves on if no other command comes
_MARGIN = 0.02  # rad
_SLOWEST = 1e-3  # rad/s; 0 would mean full speed to a servo
_REST_SPEED = 0.25  # rad/s
_ARRIVAL = 16.0  # 1/s: speed over the way that is left, where a joint stays
_ARRIVAL_SPEED = 0.3  # rad/s; the last bit of the way to where a joint stays
_AWAY = 0.1  # rad; a stuck shaft that is nearer to its reference may have come to rest there
_RELEASED_SPEED = 1.0  # rad/s
_ADRIFT = 0.1  # rad; a heavy shaft so far from its motion is elsewhere: it goes on from there
_SHOWN = 0.6  # of the acceleration that a servo has shown
_BRAKED = 0.25  # s in which a servo that accelerates no harder must be able to stop
_TURN = 0.02  # rad/s; slower motion does not change the side of the servo's dead band


class JointController:
    """Keeps one joint on a moving reference.

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
        self.servo = ServoModel(stamp, position, velocity, delay)
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
        reference: Reference,
        now: float,
        period: float,
        late: float,
        limits: MotionLimits,
        dead_band: float,
        lead: float,
    ) -> tuple[float, float]:
        """The goal [rad] and the speed [rad/s] to command now.

        Args:
            reference: where the joint should be when the servo acts.
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
        off = reference.position - motion.position
        rest.judge(reference, off, motion.velocity, setpoint, dead_band, now)
        if rest.goal is not None:
            stamp, position = servo.reading
            rest.help(position, stamp, servo.resolution, dead_band)
            goal = self._joint.clamp(rest.goal)
            motion.rest_at(reference.position)
            servo.held(now, goal)
            return goal, min(_REST_SPEED, limits.speed)
        if servo.stuck and abs(reference.position - servo.reading[1]) > _AWAY:
            return self._push(reference, now, limits, lead)
        if servo.acceleration < math.inf and abs(setpoint - motion.position) > _ADRIFT:
            motion.position, motion.velocity = setpoint, servo.velocity
        motion.steer(reference.position, reference.velocity, period, limits, self._joint)
        arrival = (
            self._arrival(reference, setpoint, now, period, limits, lead) if rest.near else None
        )
        if arrival is not None:
            goal, speed = arrival
        else:
            speed = self._setpoint_speed(setpoint, period, late, limits)
            ahead = min(abs(speed) * (period + _RESERVE) + _MARGIN, lead)
            goal = self._joint.clamp(setpoint + math.copysign(ahead, speed))
        servo.commanded(now, speed, goal)
        return goal, max(abs(speed), _SLOWEST)

    def _push(
        self, reference: Reference, now: float, limits: MotionLimits, lead: float
    ) -> tuple[float, float]:
        """The goal and the speed for a stuck shaft: let go, it turns no farther than there."""
        _, position = self.servo.reading
        way = min(max(self._joint.clamp(reference.position) - position, -lead), lead)
        speed = math.copysign(min(_RELEASED_SPEED, limits.speed), way)
        self.motion.rest_at(position)
        self.motion.velocity = speed
        self.servo.restart(now)
        self.servo.commanded(now, speed, position + way)
        return position + way, abs(speed)

    def _arrival(
        self,
        reference: Reference,
        setpoint: float,
        now: float,
        period: float,
        limits: MotionLimits,
        lead: float,
    ) -> tuple[float, float] | None:
        """The goal and the signed speed for a reference at rest: the servo itself stops there.

        None while the joint moves away from it, or is too far from it.
        """
        goal = self._joint.clamp(reference.position)
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
