"""The control loop of a simulated servo: turns settings into motion, one millisecond at a time."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Final

from head_tracking.dynamixel.models import ServoModel
from head_tracking.simulation.compliance import ComplianceLaw, Side
from head_tracking.simulation.motion import Hand, Mechanics, Shaft, Temperature
from head_tracking.simulation.setpoint import Profile, Setpoint

STEP: Final = 1_000_000
"""Period of the servo's control loop, ns."""

_DT: Final = STEP * 1e-9
_GOVERNOR: Final = 4.0  # drive per rad/s above the moving speed (ours)
_STRAIN: Final = 0.8  # current of a servo that cannot cope, of what the limit allows (ours)


class Control(Enum):
    """What the loop controls."""

    POSITION = "position"
    VELOCITY = "velocity"
    OUTPUT = "output"


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """What the control loop needs to know from the registers.

    Attributes:
        torque: Whether the motor is powered.
        control: What it controls.
        goal: Goal angle, rad; or speed, rad/s; or drive, -1 to 1.
        profile: How fast a goal is approached.
        law: How an error becomes drive.
        round: Whether the angle goes round at half a turn either way.
        governed: Whether drive is taken away above the profile's velocity.
    """

    torque: bool
    control: Control
    goal: float
    profile: Profile
    law: ComplianceLaw
    round: bool = False
    governed: bool = False

    @property
    def powered(self) -> bool:
        """Whether there is any drive."""
        return self.torque and self.law.limit > 0.0


class Drive:
    """Motor, gear, shaft and their control loop. Time is passed in, as ns that never fall.

    What happens depends on when settings change, rounded to `STEP`, and not on how often
    `advance` is called.

    Args:
        model: The servo's model.
        angle: Where the shaft stands at first, rad.
        settings: Settings at first.
        ambient_temperature: Degrees Celsius.
        start_delay: Time from a new goal to the begin of the motion, ns.

    Attributes:
        shaft: Angle and speed.
        setpoint: Where the shaft should be.
        temperature: Inside the servo.
        output: Drive of the last step, -1 to 1, counter-clockwise positive.
        current: Motor current of the last step, -1 to 1 of the stall current.
        strain: For how long the servo has not been able to cope with its load, ns.
        at_rest: Whether nothing will move until something changes.
    """

    def __init__(
        self,
        model: ServoModel,
        angle: float,
        settings: DriveSettings,
        ambient_temperature: float,
        start_delay: int = 0,
    ) -> None:
        self.shaft = Shaft(Mechanics.of(model), angle)
        self.setpoint = Setpoint(angle)
        self.temperature = Temperature(ambient_temperature)
        self.output = 0.0
        self.current = 0.0
        self.strain = 0
        self.at_rest = False
        self._settings = settings
        self._profile = settings.profile
        self._start_delay = start_delay
        self._coming: deque[tuple[int, DriveSettings]] = deque()
        self._pushed = 0.0
        self._hand: Hand | None = None
        self._time: int | None = None

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
            self._profile = settings.profile.over(settings.goal - self.setpoint.angle)
        self._settings = settings

    def turn_back(self, turns: int) -> None:
        """Count the shaft's angle as so many turns less."""
        self.shaft.angle -= turns * 2.0 * math.pi
        self.setpoint.follow(self.shaft.angle)

    def push(self, torque: float) -> None:
        """Load the shaft from outside until the next call, N m, counter-clockwise."""
        self._pushed = torque
        self.at_rest = False

    def lead(self, angle: float, duration: float, strength: float) -> None:
        """Let a hand lead the shaft to an angle, rad, within `duration` seconds, and let go."""
        time = round(duration * 1e9)
        self._hand = Hand(self._time or 0, time, self.shaft.angle, angle, strength)
        self.at_rest = False

    @property
    def approaching(self) -> bool:
        """Whether the setpoint is on its way."""
        settings = self._settings
        return settings.powered and (
            bool(self._coming)
            or self.setpoint.speed != 0.0
            or (settings.control is Control.POSITION and self.setpoint.angle != settings.goal)
        )

    @property
    def moving(self) -> bool:
        """Whether a goal is being approached."""
        settings = self._settings
        if not settings.torque:
            return False
        if settings.control is not Control.POSITION:
            return self.shaft.speed != 0.0
        return abs(settings.goal - self.shaft.angle) > self._side().margin

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
        heat, done, start = 0.0, 0, self._time
        while done < steps and not self.at_rest:
            heat += self._step(start + done * STEP, voltage) ** 2
            done += 1
        rest = steps - done
        heat += rest * self.current**2
        if self.strain:
            self.strain += rest * STEP
        self.temperature.heat(math.sqrt(heat / steps), steps * _DT)
        self._time = start + steps * STEP

    def _step(self, now: int, voltage: float) -> float:
        """Move on by one step and return the motor current, -1 to 1 of the stall current."""
        while self._coming and self._coming[0][0] <= now:
            self._use(self._coming.popleft()[1])
        shaft, setpoint, settings = self.shaft, self.setpoint, self._settings
        before = (shaft.angle, shaft.speed, setpoint.angle)
        external = self._pushed
        if self._hand is not None:
            if self._hand.holds(now):
                external += self._hand.torque(shaft, now)
            else:
                self._hand = None
        self.current = 0.0
        if settings.powered:
            self.output = self._control()
            motor = self.output * voltage
            shaft.step(motor, external, _DT, settings.round)
            self.current = motor - shaft.speed / shaft.mechanics.free_speed
        else:
            setpoint.follow(shaft.angle)
            self.output = 0.0
            shaft.step(None, external, _DT, settings.round)
        strained = settings.powered and abs(self.current) >= _STRAIN * settings.law.limit
        self.strain = self.strain + STEP if strained else 0
        after = (shaft.angle, shaft.speed, setpoint.angle)
        self.at_rest = before == after and self._hand is None and not self._coming
        return self.current

    def _control(self) -> float:
        """Return the drive, -1 to 1."""
        settings, law, shaft, setpoint = (
            self._settings,
            self._settings.law,
            self.shaft,
            self.setpoint,
        )
        if settings.control is Control.OUTPUT:
            setpoint.follow(shaft.angle)
            return max(-law.limit, min(law.limit, settings.goal))
        side, profile = self._side(), self._profile
        lead = side.margin + side.slope
        if settings.control is Control.VELOCITY:
            setpoint.run(settings.goal, profile.acceleration, shaft.angle, lead, _DT)
        else:
            setpoint.approach(settings.goal, profile, shaft.angle, lead, _DT)
        drive = law.drive(setpoint.angle - shaft.angle, shaft.speed - setpoint.speed)
        excess = abs(shaft.speed) - profile.velocity
        if settings.governed and profile.velocity > 0.0 and excess > 0.0:
            drive -= math.copysign(excess * _GOVERNOR, shaft.speed)
            drive = max(-law.limit, min(law.limit, drive))
        return drive

    def _side(self) -> Side:
        law = self._settings.law
        rising = self._settings.goal > self.shaft.angle
        return law.counterclockwise if rising else law.clockwise
