"""One joint: the motion that takes it to its reference, its rest, and its servo's commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from head_tracking.tracking.following import FollowingWatch
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
        lead: how far ahead of the set-point a goal may be [rad].
    """

    speed: float
    acceleration: float
    jerk: float
    lead: float = math.inf


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
        self,
        wanted: float,
        velocity: float,
        dt: float,
        elapsed: float,
        limits: MotionLimits,
        joint: JointLimits,
    ) -> None:
        """Choose the velocity for the next `dt` [s].

        Args:
            wanted: where the joint should be now [rad].
            velocity: how it should move in the time `dt` [rad/s].
            dt: until the next choice [s].
            elapsed: since the last choice [s]; longer than `dt` if this one is late.
            limits: how the joint may move.
            joint: its range, which is never left.
        """
        remaining = math.exp(-_RESPONSE * dt)
        # gains that put both poles of the sampled loop at `remaining`
        stiffness = (1.0 - remaining) ** 2 / (dt * dt)
        damping = (3.0 - 2.0 * remaining - remaining**2) / (2.0 * dt)
        error = wanted - self.position
        share = min(1.0, elapsed / _NEED_TIME)
        self._need += share * (abs(velocity - self._asked_velocity) / elapsed - self._need)
        self._asked_velocity = velocity
        # what the joint cannot follow it does not copy: it goes where the target is, as it can
        copied = min(max((1.0 - self._need / limits.acceleration) / _COPIED, 0.0), 1.0)
        closing = self._closing_speed(error, stiffness / damping, copied * self._need, limits)
        velocity *= copied
        asked = velocity - self._wanted_velocity
        asked += dt * damping * (closing + self._wanted_velocity - self.velocity)
        asked /= elapsed
        self._wanted_velocity = velocity
        change = limits.jerk * elapsed
        acceleration = min(max(asked, self._acceleration - change), self._acceleration + change)
        acceleration = min(max(acceleration, -limits.acceleration), limits.acceleration)
        chosen = self.velocity + acceleration * elapsed
        fastest = max(limits.speed, abs(self.velocity) - limits.acceleration * elapsed)
        chosen = min(max(chosen, -fastest), fastest)
        chosen = self._inside(chosen, dt, limits, joint)
        self._acceleration = (chosen - self.velocity) / elapsed
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
_AIM = 1.0  # s; over which the place of a joint at rest is averaged, and small errors wait
_FINE = 0.25  # of the dead band; smaller errors are not mended
_SLOW = 0.015  # rad/s; a target slower than this may be one that stands still
_UNLIKELY = 4.0  # standard deviations; at 3, noise alone would wake a joint every few seconds
_STEP = 0.004  # rad: three quarters of the step of an AX-12's encoder
_FARTHEST_HELP = 0.015  # rad


@dataclass(frozen=True, slots=True)
class Reference:
    """Where a joint should be.

    Attributes:
        position: [rad].
        velocity: [rad/s].
        noise: standard deviation of that position [rad].
        speed_noise: standard deviation of that velocity [rad/s].
        ahead: where the joint should be in the time after that, as far as a command may carry it
            if no other comes [rad].
    """

    position: float
    velocity: float = 0.0
    noise: float = 0.0
    speed_noise: float = 0.0
    ahead: tuple[float, ...] = ()


class Rest:
    """A dead band with hysteresis: easy to stay in, harder to come into.

    Attributes:
        goal: where the joint rests [rad]; None while it moves.
        near: whether the joint is wanted where it may come to rest.
    """

    def __init__(self) -> None:
        self.goal: float | None = None
        self.near = False
        self._place = 0.0  # mean of where the joint should be since it rests
        self._calm_since: float | None = None
        self._judged = self._helped = self._side = 0.0

    def judge(
        self,
        reference: Reference,
        off: float,
        speed: float,
        setpoint: float,
        dead_band: float,
        now: float,
    ) -> None:
        """Decide whether the joint rests.

        Args:
            reference: where it should be.
            off: by how much its intended motion is not there [rad].
            speed: of its intended motion [rad/s].
            setpoint: where the servo stays if no other command comes [rad].
            dead_band: errors below this are left alone [rad].
            now: the time [s].
        """
        band = min(math.hypot(dead_band, _UNLIKELY * reference.noise), 4.0 * dead_band)
        slow = min(max(2.0 * reference.speed_noise, _SLOW), 4.0 * _SLOW)
        self.near = abs(reference.velocity) <= slow
        if self.goal is not None:
            away = reference.position - self._place
            if abs(away) > band or abs(reference.velocity) > 2.5 * slow:
                self.goal = self._calm_since = None
                return
            self._place += min((now - self._judged) / _AIM, 1.0) * away
        elif not self.near or abs(speed) > slow or abs(off) > 0.5 * band:
            self._calm_since = None
        elif self._calm_since is None:
            self._calm_since = now
        elif now - self._calm_since >= _CALM:
            self.goal, self._place = setpoint, reference.position
            self._helped, self._side = now, 0.0
        self._judged = now

    def help(self, measured: float, stamp: float, dead_band: float) -> None:
        """Move the goal of a joint that rests beside its place.

        Small errors are mended slowly, and only to one side: the next one to the other side is a
        step of the encoder.

        Args:
            measured: where it stands [rad].
            stamp: when that was [s].
            dead_band: errors below this are left alone [rad].
        """
        short, coarse = self._place - measured, max(dead_band, _STEP)
        fine = _FINE * dead_band if short * self._side >= 0.0 else coarse
        waited = stamp - self._helped
        if self.goal is None or abs(short) <= (fine if waited >= _AIM else coarse):
            return
        if waited >= _SETTLED:
            self._helped, self._side = stamp, short
            ahead = self.goal - self._place + short
            self.goal = self._place + min(max(ahead, -_FARTHEST_HELP), _FARTHEST_HELP)


RESERVE = 0.15  # s: so long a servo moves on if no other command comes
_MARGIN = 0.02  # rad
_SLOWEST = 1e-3  # rad/s; 0 would mean full speed to a servo
_REST_SPEED = 0.25  # rad/s
_ARRIVAL = 16.0  # 1/s: speed over the way that is left, where a joint stays
_ARRIVAL_SPEED = 0.3  # rad/s; the last bit of the way to where a joint stays
_RELEASED_SPEED = 1.0  # rad/s
_AWAY = 0.1  # rad; a joint that stands nearer to its reference may have come to rest there
_TURN = 0.02  # rad/s; slower motion does not change the side of the servo's dead band
_UNSURE = 0.03  # s; while the deviation of the delay is more, the joint is moved cautiously
_CAUTIOUS = 12.0  # rad/s^2 of such a joint
_BRAKED = 0.25  # s in which it must be able to stop
_USED = 0.75  # of the acceleration that the servo is thought to have
_LATE = 0.04  # s between two commands; a goal that is ahead is reached in such a time
_PATIENCE = 0.35  # s more than the delay, in which a joint that follows has moved


class JointController:
    """Keep one joint on a moving reference.

    Args:
        name: of the joint.
        joint: its range.

    Attributes:
        servo: the model of its servo.
        motion: the motion that takes it to its reference.
    """

    def __init__(self, name: str, joint: JointLimits) -> None:
        self.servo = ServoModel()
        self._joint = joint
        self._watch = FollowingWatch(name)
        self.restart(0.0, joint.clamp(0.0), 0.0)

    def restart(self, stamp: float, position: float, velocity: float) -> None:
        """Start from a reading [s], [rad], [rad/s]; what was learned of the servo is kept."""
        self.servo.restart(stamp, position, velocity)
        self.motion = JointMotion(self._joint.clamp(position), velocity)
        self._watch.restart()
        self._rest = Rest()
        self._side = 0.0
        self._goal = self._speed = math.nan

    def forget(self) -> None:
        """Forget what was learned of the servo; `restart` must follow."""
        self.servo = ServoModel()

    def measured(self, stamp: float, position: float, elapsed: float) -> None:
        """Receive a reading [s], [rad], so long after the last command [s]."""
        motion = self.motion
        motion.advance(elapsed)
        if math.isfinite(self._goal):
            is_late = elapsed > _LATE
            if is_late and (motion.position - self._goal) * motion.velocity > 0.0:
                motion.rest_at(self._goal)  # the servo stopped there
            self._watch.patience = _PATIENCE + self.servo.delay
            self._watch.check(self._goal, self._speed, position, stamp)
        self.servo.measured(stamp, position)

    def follow(
        self,
        reference: Reference,
        now: float,
        period: float,
        elapsed: float,
        limits: MotionLimits,
        dead_band: float,
    ) -> tuple[float, float]:
        """Return the goal [rad] and the speed [rad/s] to command now.

        Args:
            reference: where the joint should be when the servo acts.
            now: the time [s].
            period: until the next command [s].
            elapsed: since the last command [s].
            limits: how the joint may move.
            dead_band: at rest, errors below this are left alone [rad].
        """
        self._goal, speed = self._command(reference, now, period, elapsed, limits, dead_band)
        self._speed = max(abs(speed), _SLOWEST)
        return self._goal, self._speed

    def _command(
        self,
        reference: Reference,
        now: float,
        period: float,
        elapsed: float,
        limits: MotionLimits,
        dead_band: float,
    ) -> tuple[float, float]:
        motion, servo, rest = self.motion, self.servo, self._rest
        # what the shaft cannot do is not planned; its set-point may do it
        known = servo.known_delay > 0.0 or servo.deviation < _UNSURE
        hardest = min(_USED * servo.acceleration, math.inf if known else _CAUTIOUS)
        speed = min(limits.speed, math.inf if known else _BRAKED * _CAUTIOUS)
        able = replace(limits, speed=speed, acceleration=min(limits.acceleration, hardest))
        setpoint = servo.setpoint(now)
        off = reference.position - motion.position
        rest.judge(reference, off, motion.velocity, setpoint, dead_band, now)
        if rest.goal is not None:
            stamp, position = servo.reading
            rest.help(position, stamp, dead_band)
            goal = self._joint.clamp(rest.goal)
            motion.rest_at(reference.position)
            servo.hold(now, goal)
            return goal, min(_REST_SPEED, limits.speed)
        if self._watch.problem and abs(reference.position - servo.reading[1]) > _AWAY:
            return self._push(reference, now, limits)
        astray = servo.astray(now)
        if astray is not None:
            motion.position, motion.velocity = astray
        motion.steer(reference.position, reference.velocity, period, elapsed, able, self._joint)
        if abs(motion.velocity) > _TURN or self._side == 0.0:
            self._side = math.copysign(1.0, motion.velocity) if motion.velocity else 0.0
        arrival = (
            self._arrival(reference, setpoint, period, elapsed, limits, able)
            if rest.near and astray is None
            else None
        )
        if arrival is not None:
            goal, speed = arrival
        else:
            end = motion.position + motion.velocity * period + self._side * servo.dead_band
            speed = (end - setpoint) / period
            speed = self._limited(speed, elapsed if astray is None else math.inf, limits)
            goal = self._goal_ahead(reference, setpoint, speed, period, limits.lead)
        servo.command(now, speed, goal)
        return goal, speed

    def _arrival(
        self,
        reference: Reference,
        setpoint: float,
        period: float,
        elapsed: float,
        limits: MotionLimits,
        able: MotionLimits,
    ) -> tuple[float, float] | None:
        """Return goal and signed speed for a reference at rest: the servo itself stops there.

        None while the joint moves away from it. The set-point accelerates as `limits` allow, at a
        speed from which a shaft that is `able` to do less can brake.
        """
        goal = self._joint.clamp(reference.position)
        way, last = goal - setpoint, self.servo.speed
        change = limits.acceleration * elapsed
        away = last * way < 0.0 and abs(last) > change and abs(way) > abs(last) * period
        if away or abs(way) > limits.lead:
            return None
        left = abs(goal - self.servo.reading[1])
        lost = able.acceleration * self.servo.delay
        braking = math.sqrt(lost * lost + 2.0 * able.acceleration * left) - lost
        fast = max(_ARRIVAL_SPEED, min(_ARRIVAL * left, braking))
        return goal, math.copysign(min(fast, abs(last) + change, able.speed), way)

    def _goal_ahead(
        self, reference: Reference, setpoint: float, speed: float, period: float, lead: float
    ) -> float:
        """The goal: where the servo stops if no other command comes.

        It lies ahead of the set-point, but not beyond the places where the reference will be.
        """
        way = math.copysign(1.0, speed)
        ahead = way * setpoint + min(abs(speed) * (period + RESERVE) + _MARGIN, lead)
        beyond = self.servo.dead_band + _MARGIN
        farthest = (max(reference.ahead) if way > 0.0 else -min(reference.ahead)) + beyond
        least = way * setpoint + abs(speed) * period  # a motion that brakes may go beyond
        return self._joint.clamp(way * max(min(ahead, farthest), least))

    def _push(self, reference: Reference, now: float, limits: MotionLimits) -> tuple[float, float]:
        """The goal and the speed for a joint that stands; released, it goes no farther."""
        stamp, position = self.servo.reading
        way = self._joint.clamp(reference.position) - position
        way = min(max(way, -limits.lead), limits.lead)
        speed = math.copysign(min(_RELEASED_SPEED, limits.speed), way)
        self.motion.rest_at(position)
        self.motion.velocity = speed
        self.servo.restart(stamp, position)
        self.servo.command(now, speed, position + way)
        return position + way, abs(speed)

    def _limited(self, speed: float, elapsed: float, limits: MotionLimits) -> float:
        """The nearest speed that the limits allow after the last one."""
        last, change = self.servo.speed, limits.acceleration * elapsed
        if abs(last) > limits.speed:
            change = max(change, abs(last) - limits.speed)
        speed = min(max(speed, last - change), last + change)
        fastest = max(limits.speed, abs(last) - change)
        return min(max(speed, -fastest), fastest)
