"""Motion of a simulated servo: profile, control law, motor, gear and shaft, in steps of 1 ms.

Margin, slope and punch are those of the e-manual (AX-12A, "compliance"). The proportional gain of
other models is a slope without margin and punch. Profiles of X servos are steps, rectangles,
triangles or trapezoids of velocity. The vendor does not publish dynamics: values marked "assumed"
are estimates.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, NamedTuple

from head_tracking.simulation.models import SimulatedModel

STEP: Final = 1_000_000
"""Period of the servo's control loop, ns."""

_DT: Final = STEP * 1e-9
_TIME_CONSTANT: Final = 0.04  # s until the unloaded rotor reaches 63 % of its final speed (assumed)
_STICTION: Final = 0.028  # of the stall torque: a little under the AX punch of 32/1023 (assumed)
_SLIDING: Final = 0.023  # Coulomb friction of the moving gear, of the stall torque (assumed)
_FINE: Final = 0.3  # factor of the stiction of servos without punch (assumed)
_VISCOSITY: Final = 0.3  # of the back-EMF: friction of a gear that is back-driven (assumed)
_GOVERNOR: Final = 4.0  # drive per rad/s above the moving speed (assumed)
_STRAIN: Final = 0.8  # share of the current limit that counts as overload (assumed)
_DAMPING_RATIO: Final = 0.9  # of servos with a proportional gain (assumed)
_AX_DAMPING: Final = 0.17  # drive per rad/s: a ratio of 0.83 with the default slope (assumed)
_SLOPES: Final = (128, 64, 32, 16, 8, 4)  # effective slopes: the highest one not above the register


class Profile(NamedTuple):
    """Velocity profile towards a goal."""

    velocity: float  # maximum speed, rad/s; 0: no limit
    acceleration: float = 0.0  # rad/s^2; 0: no limit


class ControlLaw(NamedTuple):
    """Drive as a function of the errors of position and speed."""

    cw_margin: float  # clockwise (falling angle) error without drive, rad
    cw_slope: float  # further clockwise error up to full drive, rad; inf: gain 0
    ccw_margin: float  # counter-clockwise error without drive, rad
    ccw_slope: float  # further counter-clockwise error up to full drive, rad
    punch: float  # drive at the edge of the margin, 0 to 1
    limit: float  # maximum drive, 0 to 1
    damping: float  # reduction of the drive per rad/s of speed error


@lru_cache(maxsize=1024)
def compliance_law(
    unit: float, margins: tuple[int, int], slopes: tuple[int, int], punch: float, limit: float
) -> ControlLaw:
    """Return the law of an AX servo; register pairs are clockwise first, `unit` is rad per tick."""
    cw, ccw = (next((step for step in _SLOPES if slope >= step), 2) for slope in slopes)
    return ControlLaw(
        margins[0] * unit, cw * unit, margins[1] * unit, ccw * unit, punch, limit, _AX_DAMPING
    )


@lru_cache(maxsize=1024)
def proportional_law(
    no_load_speed: float, slope: float, limit: float, punch: float = 0.0
) -> ControlLaw:
    """Return the law of a proportional gain; `slope` is the error at full drive, rad."""
    frequency = math.sqrt(no_load_speed / (_TIME_CONSTANT * slope))
    wanted = 2.0 * _DAMPING_RATIO * frequency - 1.0 / _TIME_CONSTANT  # less that of the motor
    damping = max(0.0, wanted * _TIME_CONSTANT / no_load_speed)
    return ControlLaw(0.0, slope, 0.0, slope, punch, limit, damping)


class DriveSettings(NamedTuple):
    """Settings of the control loop, from the registers."""

    torque: bool  # whether torque is enabled, in a mode with goal positions
    goal: float  # goal angle, rad
    profile: Profile
    law: ControlLaw
    governed: bool = False  # whether the drive is reduced above the velocity of the profile
    # Drive of a servo in wheel mode, -1 to 1; None: `law` and `goal` apply
    output: float | None = None

    @property
    def powered(self) -> bool:
        """Whether the motor can drive."""
        return self.torque and self.law.limit > 0.0


@dataclass(slots=True)
class Mechanics:
    """Motor and gear as one rigid rotor, with values at the output shaft."""

    stall_torque: float  # torque at standstill with full drive, N m
    # Speed at which the back-EMF equals full drive, rad/s. Friction reduces it to the no-load
    # speed.
    free_speed: float
    inertia: float  # inertia of rotor, gear and load, kg m^2
    stiction: float  # static friction, N m
    sliding: float  # sliding friction, N m
    scale_end: float  # half the range of the encoder, rad; inf for an encoder that counts turns
    gear_play: float = 0.0  # play between rotor and encoder, rad from side to side
    link_play: float = 0.0  # play between encoder and link, rad from side to side

    @classmethod
    def of(cls, model: SimulatedModel) -> Mechanics:
        """Return the constants for the no-load speed and stall torque of a model."""
        counts_turns = model.control == "profile"
        stiction = _STICTION if model.control == "compliance" else _FINE * _STICTION
        return cls(
            stall_torque=model.stall_torque,
            free_speed=model.no_load_speed / (1.0 - _SLIDING),
            inertia=_TIME_CONSTANT * model.stall_torque / model.no_load_speed,
            stiction=stiction * model.stall_torque,
            sliding=_SLIDING * model.stall_torque,
            scale_end=math.inf if counts_turns else model.center * model.radians_per_tick,
        )


class Hand(NamedTuple):
    """A hand that moves the shaft from one angle to another and releases it."""

    start: int  # start of the motion, ns
    duration: int  # duration of the motion, ns
    origin: float  # angle at the start, rad
    target: float  # angle at the end, rad
    strength: float  # maximum torque, N m

    def holds(self, now: int) -> bool:
        """Return whether the hand holds the shaft: until 0.2 s after the motion."""
        return now < self.start + self.duration + 200_000_000

    def torque(self, angle: float, speed: float, now: int) -> float:
        """Return the torque on the shaft, N m: a spring of 20 N m/rad, damped by 0.8 N m s/rad."""
        part = min(1.0, (now - self.start) / self.duration) if self.duration else 1.0
        wanted = self.origin + part * (self.target - self.origin)
        velocity = (self.target - self.origin) / (self.duration * 1e-9) if part < 1.0 else 0.0
        torque = 20.0 * (wanted - angle) + 0.8 * (velocity - speed)
        return max(-self.strength, min(self.strength, torque))


class Coupling:
    """A stiff bracket between two shafts: a damped spring of 20 N m/rad (assumed).

    Args:
        first: One shaft.
        second: The other shaft; the spring is unloaded at the present positions.
        direction: -1 if they turn in opposite directions (mounted face to face), else 1.
    """

    def __init__(self, first: Drive, second: Drive, direction: int) -> None:
        self._first, self._second, self._direction = first, second, direction
        self._offset = second.angle - direction * first.angle

    @property
    def twist(self) -> float:
        """Difference of the shafts, rad, without whole turns."""
        difference = self._second.angle - self._direction * self._first.angle - self._offset
        return math.remainder(difference, 2.0 * math.pi)

    def pull(self) -> None:
        """Apply the torque of the bracket to both shafts."""
        speed = self._second.speed - self._direction * self._first.speed
        torque = 20.0 * self.twist + 0.2 * speed
        self._first.pull(self._direction * torque)
        self._second.pull(-torque)


class Drive:
    """Motor, gear, shaft and control loop. Time is an argument: ns that never decrease.

    The result depends on the times at which settings change, rounded to `STEP`, and not on the
    times at which `advance` is called.

    The reference follows the profile to the goal, and the control law holds the shaft to it. The
    distance between reference and shaft is limited to the range of the law, so that a blocked shaft
    does not jump when it is released. With play, the driven part follows at the edge of the play.

    Args:
        mechanics: Motor and gear.
        angle: Initial angle of the shaft, rad, counter-clockwise.
        settings: Initial settings.
        start_delay: Time from a new goal to the start of the motion, ns.

    Attributes:
        angle: Angle of the shaft at the encoder, rad, counter-clockwise; 0 in the middle of the
            range. The shaft has no end stops.
        speed: Speed of the rotor at the shaft, rad/s.
        reference: Set-point of the angle, rad.
        reference_speed: Set-point of the speed, rad/s.
        mechanics: Motor and gear.
        output: Drive of the last step, -1 to 1, counter-clockwise positive.
        current: Motor current of the last step, -1 to 1 of the stall current.
        strain: Duration of the present overload, ns.
        at_rest: Whether nothing moves until a setting or torque changes.
    """

    def __init__(
        self,
        mechanics: Mechanics,
        angle: float,
        settings: DriveSettings,
        start_delay: int = 0,
    ) -> None:
        self.angle = self.reference = angle
        self.speed = self.reference_speed = 0.0
        self.output = self.current = 0.0
        self.strain = 0
        self.at_rest = False
        self._slack = self._lag = 0.0  # of the encoder behind the rotor, and of the link behind it
        self.mechanics = mechanics
        self._built = replace(mechanics)
        self._settings = settings
        self._start_delay = start_delay
        self._coming: deque[tuple[int, DriveSettings]] = deque()
        self._pushed = self._pulled = 0.0
        self._hand: Hand | None = None
        self._time: int | None = None

    def impede(self, share: float) -> None:
        """Set the friction to a share of the stall torque; 1 blocks the shaft, 0: the model's."""
        built = self._built
        friction = share * built.stall_torque
        self.mechanics.stiction = max(built.stiction, friction)
        self.mechanics.sliding = max(built.sliding, friction)
        self.at_rest = False

    @property
    def link(self) -> float:
        """Angle of the link, rad, counter-clockwise."""
        return self.angle - self._lag

    @property
    def measured(self) -> float:
        """Angle of the shaft in the range of the encoder, rad."""
        return self._measure(self.angle)

    def _measure(self, angle: float) -> float:
        """Return the angle that the encoder measures; outside its range, the nearer end."""
        end = self.mechanics.scale_end
        if end == math.inf:
            return angle
        return max(-end, min(end, math.remainder(angle, 2.0 * math.pi)))

    def configure(self, settings: DriveSettings) -> None:
        """Apply settings, after the start delay if the motor is driving."""
        if self._start_delay and settings.powered and self._settings.powered:
            self._coming.append(((self._time or 0) + self._start_delay, settings))
        else:
            self._coming.clear()
            self._settings = settings
        self.at_rest = False

    def subtract_turns(self, turns: int) -> None:
        """Subtract whole turns from the angles."""
        self.angle -= turns * 2.0 * math.pi
        self.reference, self.reference_speed = self.angle, 0.0

    def push(self, torque: float) -> None:
        """Apply an external torque until the next call, N m, counter-clockwise."""
        self._pushed = torque
        self.at_rest = False

    def pull(self, torque: float) -> None:
        """Apply the torque of a coupling until the next call, N m."""
        if torque != self._pulled:
            self._pulled = torque
            self.at_rest = False

    def lead(self, angle: float, duration: float, strength: float) -> None:
        """Move the shaft by hand to an angle, rad, within `duration` seconds, and release it."""
        time = round(duration * 1e9)
        self._hand = Hand(self._time or 0, time, self.angle, angle, strength)
        self.at_rest = False

    @property
    def approaching(self) -> bool:
        """Whether the reference has not reached the goal."""
        settings = self._settings
        return settings.powered and (
            bool(self._coming) or self.reference_speed != 0.0 or self.reference != settings.goal
        )

    @property
    def moving(self) -> bool:
        """Whether a goal is being approached."""
        settings = self._settings
        if not settings.torque:
            return False
        way = settings.goal - self.measured
        return abs(way) > (settings.law.ccw_margin if way > 0.0 else settings.law.cw_margin)

    def advance(self, now: int, voltage: float) -> None:
        """Simulate up to `now`, ns; time at rest needs no computation.

        Args:
            now: Time, ns.
            voltage: Supply voltage, relative to the nominal one.
        """
        if self._time is None:
            self._time = now
        steps = (now - self._time) // STEP
        if steps <= 0:
            return
        done = 0
        while done < steps and not self.at_rest:
            time, until = self._time + done * STEP, steps - done
            while self._coming and self._coming[0][0] <= time:
                self._settings = self._coming.popleft()[1]
            if self._coming:
                until = min(until, -(-(self._coming[0][0] - time) // STEP))
            done += self._move(time, until, voltage)
        rest = steps - done
        if rest and self.strain:
            self.strain += rest * STEP
        self._time += steps * STEP

    def _move(self, time: int, steps: int, voltage: float) -> int:
        """Simulate at most `steps` steps with constant settings; return the number until rest.

        The values are in local variables because this loop is most of the simulator's work.
        """
        torque_on, goal, (velocity, acceleration), law, governed, fixed = self._settings
        cw_margin, cw_slope, ccw_margin, ccw_slope, punch, limit, damping = law
        mechanics, hand, pushed = self.mechanics, self._hand, self._pushed + self._pulled
        stall, free_speed, stiction = (
            mechanics.stall_torque, mechanics.free_speed, mechanics.stiction,
        )  # fmt: skip
        scale_end = mechanics.scale_end
        half_gear, half_link = 0.5 * mechanics.gear_play, 0.5 * mechanics.link_play
        powered = torque_on and limit > 0.0
        resistance = stall / free_speed * (1.0 if powered else _VISCOSITY)
        rate = _DT / mechanics.inertia
        slowing = 1.0 + resistance * rate
        brake = mechanics.sliding * rate / slowing
        strained = _STRAIN * limit
        angle, speed, slack, lag = self.angle, self.speed, self._slack, self._lag
        has_play = bool(half_gear or half_link or slack or lag)
        reference, pace = self.reference, self.reference_speed
        output, current, strain, done = 0.0, 0.0, self.strain, 0
        while done < steps:
            speed_before, reference_before = speed, reference
            measured = angle if -scale_end <= angle <= scale_end else self._measure(angle)
            torque = pushed
            if hand is not None:
                if hand.holds(time + done * STEP):
                    torque += hand.torque(angle, speed, time + done * STEP)
                else:
                    self._hand = hand = None
            if not powered:
                reference, pace = measured, 0.0
            elif fixed is not None:
                reference, pace = measured, 0.0
                output = max(-limit, min(limit, fixed))
                torque += output * voltage * stall
            else:
                if velocity <= 0.0:
                    reference, pace = goal, 0.0
                else:
                    way, wanted = goal - reference, velocity
                    if acceleration > 0.0:
                        wanted = min(wanted, math.sqrt(2.0 * acceleration * abs(way)))
                    if way < 0.0:
                        wanted = -wanted
                    if acceleration > 0.0:
                        change = acceleration * _DT
                        wanted = max(pace - change, min(pace + change, wanted))
                    pace = wanted
                    step = pace * _DT
                    if abs(way) <= abs(step) and way * step >= 0.0:
                        reference, pace = goal, 0.0
                    else:
                        reference += step
                    lead = ccw_margin + ccw_slope if goal > measured else cw_margin + cw_slope
                    if not -lead <= reference - measured <= lead:
                        reference = max(measured - lead, min(measured + lead, reference))
                error = reference - measured
                if error > 0.0:
                    excess, slope = error - ccw_margin, ccw_slope
                else:
                    excess, slope = -error - cw_margin, cw_slope
                output = 0.0
                if excess > 0.0:
                    output = punch + excess / slope * (1.0 - punch)
                    if error < 0.0:
                        output = -output
                    output -= damping * (speed - pace)
                    if not -limit <= output <= limit:
                        output = max(-limit, min(limit, output))
                if governed and 0.0 < velocity < abs(speed):
                    output -= math.copysign((abs(speed) - velocity) * _GOVERNOR, speed)
                    if not -limit <= output <= limit:
                        output = max(-limit, min(limit, output))
                torque += output * voltage * stall
            if speed != 0.0 or abs(torque) > stiction:
                moved = (speed + torque * rate) / slowing
                if abs(moved) <= brake or moved * speed < 0.0:
                    speed = 0.0  # friction stops the shaft before it reverses
                else:
                    speed = moved - brake if moved > 0.0 else moved + brake
                turned = speed * _DT
                if has_play:
                    slack += turned
                    turned = slack - max(-half_gear, min(half_gear, slack))
                    slack -= turned
                    lag = max(-half_link, min(half_link, lag + turned))
                angle += turned
            if powered:
                current = output * voltage - speed / free_speed
                strain = strain + STEP if abs(current) >= strained else 0
            done += 1
            if (
                speed == speed_before == 0.0
                and reference == reference_before
                and hand is None
                and not self._coming
            ):
                self.at_rest = True
                break
        self.angle, self.speed, self.output, self.current = angle, speed, output, current
        self._slack, self._lag = slack, lag
        self.reference, self.reference_speed = reference, pace
        self.strain = strain if powered else 0
        return done
