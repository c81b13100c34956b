"""How a simulated servo moves: reference, control law, motor, gear and shaft, a millisecond a step.

Margin, slope and punch are the vendor's (e-manual page AX-12A, "compliance"), and so are the
proportional gain of other models, which is a slope without margin and punch, and the X profiles:
step, rectangle, triangle or trapezoid of velocity. The vendor publishes no dynamics: what is marked
"ours" is plausible.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from typing import Final, NamedTuple

from head_tracking.simulation.models import SimulatedModel

STEP: Final = 1_000_000
"""Period of the servo's control loop, ns."""

_DT: Final = STEP * 1e-9
_TIME_CONSTANT: Final = 0.04  # s in which the free rotor reaches 63 % of its final speed (ours)
_STICTION: Final = 0.028  # of the stall torque: a little under the AX punch of 32/1023 (ours)
_SLIDING: Final = 0.023  # Coulomb friction of the moving gear, of the stall torque (ours)
_FINE: Final = 0.3  # of that stiction have servos whose control law has no punch (ours)
_VISCOSITY: Final = 0.02  # of the back-EMF: what slows a shaft without power (ours)
_GOVERNOR: Final = 4.0  # drive per rad/s above the moving speed (ours)
_STRAIN: Final = 0.8  # current of a servo that cannot cope, of what the limit allows (ours)
_DAMPING_RATIO: Final = 0.9  # of servos with a proportional gain (ours)
_AX_DAMPING: Final = 0.17  # drive per rad/s: a ratio of 0.83 with the default slope (ours)
_SLOPES: Final = (128, 64, 32, 16, 8, 4)  # steps of a slope register: the highest not above it


class Control(Enum):
    """What the loop controls."""

    POSITION = "position"
    VELOCITY = "velocity"
    OUTPUT = "output"


class Profile(NamedTuple):
    """How fast a goal is approached.

    Attributes:
        velocity: Highest speed, rad/s; 0 is no limit.
        acceleration: rad/s^2; 0 is at once.
        duration: Time for the whole way, s; 0: `velocity` and `acceleration` hold instead.
        ramp: The part of `duration` in which speed rises, s.
    """

    velocity: float
    acceleration: float = 0.0
    duration: float = 0.0
    ramp: float = 0.0

    def over(self, distance: float) -> Profile:
        """Return the profile by velocity that takes the duration for a distance, rad."""
        if self.duration <= 0.0:
            return self
        ramp = min(self.ramp, self.duration / 2.0)
        velocity = abs(distance) / (self.duration - ramp)
        if self.velocity > 0.0:
            velocity = min(velocity, self.velocity)
        return Profile(velocity, velocity / ramp if ramp else 0.0)


class ControlLaw(NamedTuple):
    """Drive as a function of the errors of position and speed.

    Attributes:
        cw_margin: Error without drive where the shaft must turn clockwise (falling angle), rad.
        cw_slope: Further error up to full drive, rad; inf for a gain of 0.
        ccw_margin: The same counter-clockwise.
        ccw_slope: The same counter-clockwise.
        punch: Drive at the edge of the margin, 0 to 1.
        limit: Highest drive, 0 to 1.
        damping: Drive taken away per rad/s of speed error.
    """

    cw_margin: float
    cw_slope: float
    ccw_margin: float
    ccw_slope: float
    punch: float
    limit: float
    damping: float


@lru_cache(maxsize=1024)
def compliance_law(
    unit: float, margins: tuple[int, int], slopes: tuple[int, int], punch: float, limit: float
) -> ControlLaw:
    """Return the law of an AX from its registers, clockwise first; `unit` is rad per tick."""
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
    wanted = 2.0 * _DAMPING_RATIO * frequency - 1.0 / _TIME_CONSTANT  # the motor damps too
    damping = max(0.0, wanted * _TIME_CONSTANT / no_load_speed)
    return ControlLaw(0.0, slope, 0.0, slope, punch, limit, damping)


class DriveSettings(NamedTuple):
    """What the control loop needs to know from the registers.

    Attributes:
        torque: Whether the motor is powered.
        control: What it controls.
        goal: Goal angle, rad; or speed, rad/s; or drive, -1 to 1.
        profile: How fast a goal is approached.
        law: How an error becomes drive.
        governed: Whether drive is taken away above the profile's velocity.
    """

    torque: bool
    control: Control
    goal: float
    profile: Profile
    law: ControlLaw
    governed: bool = False

    @property
    def powered(self) -> bool:
        """Whether there is any drive."""
        return self.torque and self.law.limit > 0.0


@dataclass(slots=True)
class Mechanics:
    """A motor with its gear as one rigid rotor, seen at the output shaft.

    Attributes:
        stall_torque: At standstill with full drive, N m.
        free_speed: Speed at which the back-EMF equals full drive, rad/s. With friction the
            unloaded servo reaches its no-load speed.
        inertia: Of the rotor with its gear and all that they turn, kg m^2.
        stiction: Torque up to which a standing shaft does not move, N m.
        sliding: Friction of the moving shaft, N m.
        scale_end: Half the angle that the encoder measures, rad, of one that counts no turns; the
            rest of a turn is dead.
        gear_play: Play before the encoder, between rotor and shaft, rad from side to side.
        link_play: Play behind the encoder, between shaft and link, rad from side to side.
    """

    stall_torque: float
    free_speed: float
    inertia: float
    stiction: float
    sliding: float
    scale_end: float
    gear_play: float = 0.0
    link_play: float = 0.0

    @classmethod
    def of(cls, model: SimulatedModel) -> Mechanics:
        """Return the constants that give a model its no-load speed and stall torque."""
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
    """A hand that leads the shaft from one angle to another and then lets go.

    Attributes:
        start: When it takes hold, ns.
        duration: Time for the way, ns.
        origin: Angle at the start, rad.
        target: Angle at the end, rad.
        strength: Highest torque, N m.
    """

    start: int
    duration: int
    origin: float
    target: float
    strength: float

    def holds(self, now: int) -> bool:
        """Return whether the hand is still on the shaft: it rests at the target for 0.2 s."""
        return now < self.start + self.duration + 200_000_000

    def torque(self, angle: float, speed: float, now: int) -> float:
        """Return the torque on the shaft, N m: a spring of 20 N m/rad, damped by 0.8 N m s/rad."""
        way = min(1.0, (now - self.start) / self.duration) if self.duration else 1.0
        wanted = self.origin + way * (self.target - self.origin)
        pace = (self.target - self.origin) / (self.duration * 1e-9) if way < 1.0 else 0.0
        torque = 20.0 * (wanted - angle) + 0.8 * (pace - speed)
        return max(-self.strength, min(self.strength, torque))


class Coupling:
    """A stiff bracket by which two shafts turn together: a spring of 20 N m/rad, damped (ours).

    Args:
        first: One shaft.
        second: The other one; as they stand now, the bracket is not strained.
        direction: -1 if they are mounted face to face and turn against each other, else 1.
    """

    def __init__(self, first: Drive, second: Drive, direction: int) -> None:
        self._first, self._second, self._direction = first, second, direction
        self._offset = second.angle - direction * first.angle

    @property
    def twist(self) -> float:
        """By how much the shafts are apart, rad; which turn a servo counts makes no difference."""
        apart = self._second.angle - self._direction * self._first.angle - self._offset
        return math.remainder(apart, 2.0 * math.pi)

    def pull(self) -> None:
        """Load both shafts with what strains the bracket."""
        pace = self._second.speed - self._direction * self._first.speed
        torque = 20.0 * self.twist + 0.2 * pace
        self._first.pull(self._direction * torque)
        self._second.pull(-torque)


class Temperature:
    """A slow thermal model: one heat capacity that cools to the surroundings (ours).

    Attributes:
        celsius: Temperature inside the servo.
    """

    _AMBIENT = 25.0  # degrees Celsius
    _CAPACITY = 50.0  # J/K: 54.6 g of plastic, copper and steel
    _RESISTANCE = 10.0  # K/W to the surroundings
    _IDLE = 0.5  # W of the electronics
    _STALL = 18.0  # W at standstill with full drive: 1.5 A at 12 V

    def __init__(self) -> None:
        self.celsius = self._AMBIENT + self._IDLE * self._RESISTANCE

    def heat(self, current: float, seconds: float) -> None:
        """Pass some time with a current, as its root mean square, 0 to 1 of the stall current."""
        power = self._IDLE + self._STALL * current * current
        final = self._AMBIENT + power * self._RESISTANCE
        decay = math.exp(-seconds / (self._CAPACITY * self._RESISTANCE))
        self.celsius = final + (self.celsius - final) * decay


class Drive:
    """Motor, gear, shaft and their control loop. Time is passed in, as ns that never fall.

    What happens depends on when settings change, rounded to `STEP`, and not on how often
    `advance` is called.

    The reference moves to the goal as the profile says, and the control law holds the shaft to it.
    It never runs further ahead of the shaft than the law can use, so that a shaft that was blocked
    does not jump when it comes free.

    Friction holds the shaft, and then the link, wherever the play lets it: each is dragged along by
    the edge of its play.

    Args:
        model: The servo's model.
        angle: Where the shaft stands at first, rad, counter-clockwise.
        settings: Settings at first.
        start_delay: Time from a new goal to the begin of the motion, ns.
        mechanics: Motor and gear; None: as the model is built.

    Attributes:
        angle: Of the shaft, where the encoder sits, rad, counter-clockwise; 0 at the middle of the
            servo's range. No end stop keeps a servo's shaft from turning all round.
        link: Angle of what the shaft carries, rad, counter-clockwise.
        speed: Of the rotor, seen at the shaft, rad/s.
        reference: Where the shaft should be, rad.
        reference_speed: How fast it should move, rad/s.
        temperature: Inside the servo.
        mechanics: Motor and gear.
        output: Drive of the last step, -1 to 1, counter-clockwise positive.
        current: Motor current of the last step, -1 to 1 of the stall current.
        strain: For how long the servo has not been able to cope with its load, ns.
        at_rest: Whether nothing will move until something changes.
    """

    def __init__(
        self,
        model: SimulatedModel,
        angle: float,
        settings: DriveSettings,
        start_delay: int = 0,
        mechanics: Mechanics | None = None,
    ) -> None:
        self.angle = self.reference = self.link = self._rotor = angle
        self.speed = self.reference_speed = 0.0
        self.temperature = Temperature()
        self.output = self.current = 0.0
        self.strain = 0
        self.at_rest = False
        self.mechanics = mechanics or Mechanics.of(model)
        self._built = replace(self.mechanics)
        self._settings = settings
        self._profile = settings.profile
        self._start_delay = start_delay
        self._coming: deque[tuple[int, DriveSettings]] = deque()
        self._pushed = self._pulled = 0.0
        self._hand: Hand | None = None
        self._time: int | None = None

    def impede(self, share: float) -> None:
        """Give the gear a friction of so much of the stall torque; 1 jams it, 0 is as built."""
        built = self._built
        friction = share * built.stall_torque
        self.mechanics.stiction = max(built.stiction, friction)
        self.mechanics.sliding = max(built.sliding, friction)
        self.at_rest = False

    @property
    def measured(self) -> float:
        """Angle of the shaft as the encoder sees it, rad."""
        return self._measure(self.angle)

    def _measure(self, angle: float) -> float:
        """Return what the encoder sees: in the dead angle, the nearer end of its scale."""
        end = self.mechanics.scale_end
        if end == math.inf:
            return angle
        return max(-end, min(end, math.remainder(angle, 2.0 * math.pi)))

    def configure(self, settings: DriveSettings) -> None:
        """Use other settings from now on, or from when the servo reacts to a new goal."""
        if self._start_delay and settings.powered and self._settings.powered:
            self._coming.append(((self._time or 0) + self._start_delay, settings))
        else:
            self._coming.clear()
            self._use(settings)
        self.at_rest = False

    def _use(self, settings: DriveSettings) -> None:
        if settings.goal != self._settings.goal or settings.profile != self._settings.profile:
            self._profile = settings.profile.over(settings.goal - self.reference)
        self._settings = settings

    def turn_back(self, turns: int) -> None:
        """Count the shaft's angle as so many turns less."""
        angle = turns * 2.0 * math.pi
        self._rotor, self.angle, self.link = (
            self._rotor - angle, self.angle - angle, self.link - angle,
        )  # fmt: skip
        self.reference, self.reference_speed = self.angle, 0.0

    def push(self, torque: float) -> None:
        """Load the shaft from outside until the next call, N m, counter-clockwise."""
        self._pushed = torque
        self.at_rest = False

    def pull(self, torque: float) -> None:
        """Load the shaft by what it is coupled to, until the next call, N m."""
        if torque != self._pulled:
            self._pulled = torque
            self.at_rest = False

    def lead(self, angle: float, duration: float, strength: float) -> None:
        """Let a hand lead the shaft to an angle, rad, within `duration` seconds, and let go."""
        time = round(duration * 1e9)
        self._hand = Hand(self._time or 0, time, self.angle, angle, strength)
        self.at_rest = False

    @property
    def approaching(self) -> bool:
        """Whether the reference is on its way."""
        settings = self._settings
        return settings.powered and (
            bool(self._coming)
            or self.reference_speed != 0.0
            or (settings.control is Control.POSITION and self.reference != settings.goal)
        )

    @property
    def moving(self) -> bool:
        """Whether a goal is being approached."""
        settings = self._settings
        if not settings.torque:
            return False
        if settings.control is not Control.POSITION:
            return self.speed != 0.0
        way = settings.goal - self.measured
        return abs(way) > (settings.law.ccw_margin if way > 0.0 else settings.law.cw_margin)

    def advance(self, now: int, voltage: float) -> None:
        """Let time pass up to `now`, ns; time at rest costs nothing.

        Args:
            now: Time, ns.
            voltage: Supply in that time, in parts of the nominal one.
        """
        if self._time is None:
            self._time = now
        steps = (now - self._time) // STEP
        if steps <= 0:
            return
        heat, done = 0.0, 0
        while done < steps and not self.at_rest:
            time, until = self._time + done * STEP, steps - done
            while self._coming and self._coming[0][0] <= time:
                self._use(self._coming.popleft()[1])
            if self._coming:
                until = min(until, -(-(self._coming[0][0] - time) // STEP))
            moved, warmth = self._move(time, until, voltage)
            done, heat = done + moved, heat + warmth
        rest = steps - done
        if rest and self.strain:
            self.strain += rest * STEP
        heat += rest * self.current**2
        self.temperature.heat(math.sqrt(heat / steps), steps * _DT)
        self._time += steps * STEP

    def _move(self, time: int, steps: int, voltage: float) -> tuple[int, float]:
        """Move on by at most so many steps with the same settings, until nothing moves any more.

        All that a step needs is in local names, because it is most of the simulator's work.

        Returns:
            How many steps, and the sum of the squares of the current.
        """
        torque_on, control, goal, _, law, governed = self._settings
        cw_margin, cw_slope, ccw_margin, ccw_slope, punch, limit, damping = law
        velocity, acceleration, _, _ = self._profile
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
        by_position, by_velocity = control is Control.POSITION, control is Control.VELOCITY
        rotor, angle, link, speed = self._rotor, self.angle, self.link, self.speed
        reference, pace = self.reference, self.reference_speed
        output, current, strain, heat, done = 0.0, 0.0, self.strain, 0.0, 0
        while done < steps:
            rotor_before, speed_before, reference_before = rotor, speed, reference
            measured = angle if -scale_end <= angle <= scale_end else self._measure(angle)
            torque = pushed
            if hand is not None:
                if hand.holds(time + done * STEP):
                    torque += hand.torque(angle, speed, time + done * STEP)
                else:
                    self._hand = hand = None
            if not powered:
                reference, pace = measured, 0.0
            else:
                if not (by_position or by_velocity):
                    reference, pace = measured, 0.0
                    output = max(-limit, min(limit, goal))
                else:
                    if by_position and velocity <= 0.0:
                        reference, pace = goal, 0.0
                    else:
                        way, wanted = goal - reference, goal
                        if by_position:
                            wanted = velocity
                            if acceleration > 0.0:
                                wanted = min(wanted, math.sqrt(2.0 * acceleration * abs(way)))
                            if way < 0.0:
                                wanted = -wanted
                        if acceleration > 0.0:
                            change = acceleration * _DT
                            wanted = max(pace - change, min(pace + change, wanted))
                        pace = wanted
                        step = pace * _DT
                        if by_position and abs(way) <= abs(step) and way * step >= 0.0:
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
                    speed = 0.0  # friction stops the shaft before it turns back
                else:
                    speed = moved - brake if moved > 0.0 else moved + brake
                rotor += speed * _DT
                angle = _drag(angle, rotor, half_gear) if half_gear else rotor
                link = _drag(link, angle, half_link) if half_link else angle
            if powered:
                current = output * voltage - speed / free_speed
                strain = strain + STEP if abs(current) >= strained else 0
                heat += current * current
            done += 1
            if (
                speed == speed_before
                and rotor == rotor_before
                and reference == reference_before
                and hand is None
                and not self._coming
            ):
                self.at_rest = True
                break
        self._rotor, self.angle, self.link = rotor, angle, link
        self.speed, self.output, self.current = speed, output, current
        self.reference, self.reference_speed = reference, pace
        self.strain = strain if powered else 0
        return done, heat


def _drag(angle: float, driver: float, half: float) -> float:
    """Return where something stands that a driver drags along by half a play to either side."""
    return max(driver - half, min(driver + half, angle))
