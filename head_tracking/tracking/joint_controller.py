"""Control one joint: planned motion to the reference, dead band at rest, servo commands."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.tracking.following import FollowingWatch
from head_tracking.tracking.servo_model import ShaftModel
from head_tracking.transforms import JointLimits

_RESPONSE = 40.0  # 1/s: rate at which a position error decays
_BRAKING = 0.6  # share of the acceleration used to plan where to brake
_LEAST_BRAKING = 0.05
_NEED_TIME = 0.3  # s


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of a joint's motion.

    Attributes:
        speed: [rad/s].
        acceleration: [rad/s^2].
        jerk: [rad/s^3].
        lead: largest distance from the set-point to a goal [rad].
    """

    speed: float
    acceleration: float
    jerk: float
    lead: float = math.inf


class JointMotion:
    """Plan the motion of a joint to a moving reference.

    The reference velocity is fed forward. A position error decays like a critically damped
    spring; a large one is reduced at a speed from which the joint can brake.

    Args:
        position: present position of the joint [rad].
        velocity: present velocity [rad/s].

    Attributes:
        position: planned position [rad].
        velocity: planned velocity [rad/s].
    """

    def __init__(self, position: float, velocity: float = 0.0) -> None:
        self.position = position
        self.velocity = velocity
        self._acceleration = 0.0
        self._wanted_velocity = velocity
        self._need = 0.0

    def rest_at(self, position: float) -> None:
        """Plan no motion; the joint is at this position [rad]."""
        self.position = position
        self.velocity = self._acceleration = self._wanted_velocity = 0.0

    def steer(
        self,
        wanted: float,
        velocity: float,
        dt: float,
        elapsed: float,
        limits: MotionLimits,
        joint: JointLimits,
    ) -> None:
        """Set the velocity for the next `dt` [s].

        Args:
            wanted: reference position now [rad].
            velocity: reference velocity during `dt` [rad/s].
            dt: time to the next call [s].
            elapsed: time since the last call [s]; longer than `dt` if this one is late.
            limits: limits of the motion.
            joint: range of the joint.
        """
        remaining = math.exp(-_RESPONSE * dt)
        # gains that put both poles of the sampled loop at `remaining`
        stiffness = (1.0 - remaining) ** 2 / (dt * dt)
        damping = (3.0 - 2.0 * remaining - remaining**2) / (2.0 * dt)
        error = wanted - self.position
        share = min(1.0, elapsed / _NEED_TIME)
        self._need += share * (abs(velocity - self._wanted_velocity) / elapsed - self._need)
        closing = self._closing_speed(error, stiffness / damping, self._need, limits)
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
        """Return the speed that reduces an error: proportional, or one that allows braking."""
        spare = limits.acceleration - min(need, limits.acceleration)
        braking = max(_BRAKING * spare, _LEAST_BRAKING * limits.acceleration)
        linear = braking / gain**2  # where the two meet with the same slope
        if abs(error) <= linear:
            return gain * error
        return math.copysign(math.sqrt(braking * (2.0 * abs(error) - linear)), error)

    def _inside(
        self, velocity: float, dt: float, limits: MotionLimits, joint: JointLimits
    ) -> float:
        """Reduce a velocity so that the joint stops at the end of its range."""
        room = joint.upper - self.position if velocity > 0.0 else self.position - joint.lower
        if not math.isfinite(room):
            return velocity
        room = max(0.0, room)
        a = _BRAKING * limits.acceleration
        fastest = a * (math.sqrt(dt * dt + 2.0 * room / a) - dt)
        return min(max(velocity, -fastest), fastest)


_CALM = 0.1  # s; minimum time at the reference before a joint rests
_SETTLED = 0.2  # s; minimum time between two corrections at rest
_AIM = 1.0  # s; averaging time of the reference at rest, and delay of small corrections
_FINE = 0.25  # of the dead band; smaller errors are not corrected
_SLOW = 0.015  # rad/s; a slower reference may be at rest
_UNLIKELY = 4.0  # standard deviations; at 3, noise alone would end the rest every few seconds
_UNCERTAIN = 1.5  # deviations of a point; a joint does not begin to rest at a less certain target,
_SOON = 0.4  # s: one whose place, and velocity times this, are uncertain
_WANDERS, _WANDERS_FAR = 0.9, 0.8  # deviations of a point and dead bands: at a target that wanders
_RESTS_AGAIN = 0.7  # by more a joint does not rest, and again below this share of the mean square
_WANDER_MEMORY = 3.0  # s
_WANDERS_MOST = 1.7  # times that: weight of one outlier
_STEP = 0.004  # rad: three quarters of the step of an AX-12's encoder
_LARGEST_CORRECTION = 0.015  # rad
_DRIFT_MEMORY = 0.6  # s: averaging time of a reference that drifts
_CREEP = 0.003  # rad/s; a reference that is slower does not drift


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of a joint.

    Attributes:
        position: [rad].
        velocity: [rad/s].
        noise: standard deviation of `position` [rad].
        speed_noise: standard deviation of `velocity` [rad/s].
        ahead: later reference positions [rad]; a goal does not lie beyond them.
        scatter: standard deviation of a measured position of the target [rad].
    """

    position: float
    velocity: float = 0.0
    noise: float = 0.0
    speed_noise: float = 0.0
    ahead: tuple[float, ...] = ()
    scatter: float = 0.0


class Rest:
    """Dead band with hysteresis for a joint at rest.

    Attributes:
        goal: goal of the joint at rest [rad]; None while it moves.
        near: whether the reference is slow enough for the joint to rest.
    """

    def __init__(self) -> None:
        self.goal: float | None = None
        self.near = False
        self._place = 0.0  # mean reference since the joint rests, or where its line is now
        self._line = self._drift = 0.0  # [rad], [rad/s]
        self._drifts = False
        self._wander = 0.0  # mean square of the distance from the line, over what noise explains
        self._calm_since: float | None = None
        self._judged: float | None = None
        self._corrected = self._side = 0.0

    def judge(
        self,
        reference: Reference,
        off: float,
        setpoint: float,
        dead_band: float,
        now: float,
    ) -> None:
        """Begin or end the rest.

        Args:
            reference: the reference.
            off: from the set-point to the reference [rad].
            setpoint: where the servo stops without another command [rad].
            dead_band: smaller errors are not corrected [rad].
            now: the time [s].
        """
        band = min(math.hypot(dead_band, _UNLIKELY * reference.noise), 4.0 * dead_band)
        slow = min(max(2.0 * reference.speed_noise, _SLOW), 4.0 * _SLOW)
        self.near = abs(reference.velocity) <= slow
        if self._judged is None:
            self._line, self._judged = reference.position, now
        self._average(reference, dead_band, now - self._judged)
        self._judged = now
        if self.goal is not None:
            away = abs(reference.position - self._place)
            if away > band or abs(reference.velocity) > 2.5 * slow or self._wander > 1.0:
                self.goal = self._calm_since = None
        elif (
            not self.near
            or abs(off) > 0.5 * band
            or self._wander > _RESTS_AGAIN
            or min(reference.noise, _SOON * reference.speed_noise) > _UNCERTAIN * reference.scatter
        ):
            self._calm_since = None
        elif self._calm_since is None:
            self._calm_since = now
        elif now - self._calm_since >= _CALM:
            self.goal, self._place = setpoint, reference.position
            self._line, self._drift, self._drifts = reference.position, 0.0, False
            self._corrected, self._side = now, 0.0

    def _average(self, reference: Reference, dead_band: float, dt: float) -> None:
        """Update the place, and how far the reference wanders, after a time `dt` [s].

        The line is a critically damped alpha-beta filter. It is used if its drift is larger than
        noise explains: its position has more noise than the mean, but no lag. The reference wanders
        if it is farther from the line than the noise of the points and the dead band explain.
        """
        kept = math.exp(-dt / _DRIFT_MEMORY)
        self._line += self._drift * dt
        off = reference.position - self._line
        self._line += (1.0 - kept * kept) * off
        self._drift += (1.0 - kept) / _DRIFT_MEMORY * off
        self._drifts = abs(self._drift) > max(_CREEP, reference.noise / _AIM)
        if self._drifts:
            self._place = self._line
        else:
            self._place += min(dt / _AIM, 1.0) * (reference.position - self._place)
        noise = math.hypot(_WANDERS_FAR * max(dead_band, _STEP), _WANDERS * reference.scatter)
        away = min(abs(off) / noise, _WANDERS_MOST)
        self._wander += (1.0 - math.exp(-dt / _WANDER_MEMORY)) * (away * away - self._wander)

    def correct(self, measured: float, stamp: float, dead_band: float) -> None:
        """Move the goal of a joint that rests beside its reference.

        Small errors are corrected slowly and to one side only; a small error to the other side
        may be a step of the encoder. Behind a reference that drifts they are corrected soon, and
        the goal is in the middle of the way until the next correction.

        Args:
            measured: position of the joint [rad].
            stamp: time of that measurement [s].
            dead_band: smaller errors are not corrected [rad].
        """
        short, coarse = self._place - measured, max(dead_band, _STEP)
        fine = _FINE * dead_band if short * self._side >= 0.0 else coarse
        waited = stamp - self._corrected
        behind = self._drifts and short * self._drift > 0.0
        if self.goal is None or abs(short) <= (fine if waited >= _AIM or behind else coarse):
            return
        if waited >= _SETTLED:
            self._corrected, self._side = stamp, short
            ahead = self.goal - self._place + short
            if behind:
                ahead += 0.5 * _SETTLED * self._drift
            self.goal = self._place + min(max(ahead, -_LARGEST_CORRECTION), _LARGEST_CORRECTION)


RESERVE = 0.15  # s: time for which a servo moves on without another command
_MARGIN = 0.02  # rad
_SLOWEST = 1e-3  # rad/s; 0 would mean full speed to a servo
_REST_SPEED = 0.25  # rad/s
_ARRIVAL = 16.0  # 1/s: speed over the remaining distance to a reference at rest
_ARRIVAL_SPEED = 0.3  # rad/s; least speed towards it
_LAG = 0.02  # s; a shaft that brakes is behind its set-point, beside the delay
_RELEASED_SPEED = 1.0  # rad/s
_AWAY = 0.1  # rad; a joint nearer to its reference may be at rest
_TURN = 0.02  # rad/s; slower motion does not change the side of the servo's dead band
_UNSURE = 0.03  # s; with a larger deviation of the delay, the joint moves cautiously:
_CAUTIOUS = 12.0  # rad/s^2
_BRAKED = 0.25  # s to stop
_RAMP = 1.5  # of the shaft's acceleration: largest acceleration of the set-point on that way
_USED = 0.65  # of the estimated acceleration of the servo
_STEADY = 0.7  # of that: for an oscillation; the rest reduces the error
_LATE = 0.04  # s; after a longer time between two commands, a goal may have been reached
_PATIENCE = 0.35  # s plus the delay, in which a joint that follows has moved


class JointController:
    """Keep one joint on a moving reference.

    Args:
        joint: range of the joint.
        servo: model of its servo.

    Attributes:
        servo: as given.
        motion: planned motion.
    """

    def __init__(self, joint: JointLimits, servo: ShaftModel) -> None:
        self.servo = servo
        self._joint = joint
        self._watch = FollowingWatch()
        self._begin(0.0, 0.0)

    def restart(self, stamp: float, position: float, velocity: float) -> None:
        """Start from a reading [s], [rad], [rad/s]; the estimates of the servo are kept."""
        self.servo.restart(stamp, position, velocity)
        self._begin(position, velocity)

    def _begin(self, position: float, velocity: float) -> None:
        self.motion = JointMotion(self._joint.clamp(position), velocity)
        self._watch.restart()
        self._stands = False
        self._rest = Rest()
        self._side = 0.0
        self._goal = self._speed = math.nan
        self._last = velocity  # the speed from which the next one may differ by the acceleration

    def steady_acceleration(self, most: float) -> float:
        """Return the highest acceleration of an oscillation that the joint follows [rad/s^2].

        Args:
            most: highest acceleration by the parameters [rad/s^2].
        """
        return _STEADY * min(most, self._usable)

    @property
    def _usable(self) -> float:
        """The acceleration of the servo that is used [rad/s^2]."""
        return _USED * self.servo.acceleration

    def measured(self, stamp: float, position: float, elapsed: float) -> None:
        """Receive a reading [s], [rad], a time `elapsed` [s] after the last command."""
        motion = self.motion
        motion.position += motion.velocity * elapsed
        if math.isfinite(self._goal):
            is_late = elapsed > _LATE
            if is_late and (motion.position - self._goal) * motion.velocity > 0.0:
                motion.rest_at(self._goal)  # the servo stopped there
            self._watch.patience = _PATIENCE + self.servo.delay
            self._stands = self._watch.check(self._goal, self._speed, position, stamp)
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
            reference: reference at the time when the servo acts.
            now: the time [s].
            period: time to the next command [s].
            elapsed: time since the last command [s].
            limits: limits of the motion.
            dead_band: at rest, smaller errors are not corrected [rad].
        """
        motion, servo, rest = self.motion, self.servo, self._rest
        known = servo.parameters.servo_delay > 0.0 or servo.deviation < _UNSURE
        hardest = min(self._usable, math.inf if known else _CAUTIOUS)
        speed = min(limits.speed, math.inf if known else _BRAKED * _CAUTIOUS)
        acceleration = min(limits.acceleration, hardest)
        able = MotionLimits(speed, acceleration, limits.jerk, limits.lead)  # of the shaft
        setpoint = servo.setpoint(now)
        off = reference.position - setpoint
        rest.judge(reference, off, setpoint, dead_band, now)
        if rest.goal is not None:
            stamp, position = servo.reading
            rest.correct(position, stamp, dead_band)
            goal = self._joint.clamp(rest.goal)
            motion.rest_at(reference.position)
            servo.hold(now, goal)
            self._last = 0.0
            return self._commanded(goal, min(_REST_SPEED, limits.speed))
        if self._stands and abs(reference.position - servo.reading[1]) > _AWAY:
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
        self._last = speed if astray is None else astray[1]
        return self._commanded(goal, speed)

    def _commanded(self, goal: float, speed: float) -> tuple[float, float]:
        """Record and return the goal, and the speed without its sign."""
        self._goal, self._speed = goal, max(abs(speed), _SLOWEST)
        return self._goal, self._speed

    def _arrival(
        self,
        reference: Reference,
        setpoint: float,
        period: float,
        elapsed: float,
        limits: MotionLimits,
        able: MotionLimits,
    ) -> tuple[float, float] | None:
        """Return goal [rad] and speed [rad/s] for a reference at rest; the servo stops there.

        The set-point accelerates within `limits`, to a speed from which a shaft that is only as
        fast as `able` can brake. None while the joint moves away from the reference.
        """
        goal = self._joint.clamp(reference.position)
        way, last = goal - setpoint, self._last
        change = min(limits.acceleration, _RAMP * able.acceleration) * elapsed
        away = last * way < 0.0 and abs(last) > change and abs(way) > abs(last) * period
        if away or abs(way) > limits.lead:
            return None
        left = abs(goal - self.servo.reading[1])
        lost = able.acceleration * (self.servo.delay + _LAG)
        braking = math.sqrt(lost * lost + 2.0 * able.acceleration * left) - lost
        fast = max(_ARRIVAL_SPEED, min(_ARRIVAL * left, braking))
        return goal, math.copysign(min(fast, abs(last) + change, able.speed), way)

    def _goal_ahead(
        self, reference: Reference, setpoint: float, speed: float, period: float, lead: float
    ) -> float:
        """Return the goal, where the servo stops without another command [rad].

        It lies ahead of the set-point, but not beyond the later positions of the reference.
        """
        way = math.copysign(1.0, speed)
        ahead = way * setpoint + min(abs(speed) * (period + RESERVE) + _MARGIN, lead)
        beyond = self.servo.dead_band + _MARGIN
        farthest = (max(reference.ahead) if way > 0.0 else -min(reference.ahead)) + beyond
        least = way * setpoint + abs(speed) * period  # a motion that brakes may go beyond
        return self._joint.clamp(way * max(min(ahead, farthest), least))

    def _push(self, reference: Reference, now: float, limits: MotionLimits) -> tuple[float, float]:
        """Return goal and speed for a joint that does not follow its commands."""
        stamp, position = self.servo.reading
        way = self._joint.clamp(reference.position) - position
        way = min(max(way, -limits.lead), limits.lead)
        speed = math.copysign(min(_RELEASED_SPEED, limits.speed), way)
        self.motion.rest_at(position)
        self.motion.velocity = speed
        self.servo.restart(stamp, position)
        self.servo.command(now, speed, position + way)
        self._last = speed
        return self._commanded(position + way, speed)

    def _limited(self, speed: float, elapsed: float, limits: MotionLimits) -> float:
        """Return the nearest speed that the limits allow after the last one."""
        last, change = self._last, limits.acceleration * elapsed
        if abs(last) > limits.speed:
            change = max(change, abs(last) - limits.speed)
        speed = min(max(speed, last - change), last + change)
        fastest = max(limits.speed, abs(last) - change)
        return min(max(speed, -fastest), fastest)
