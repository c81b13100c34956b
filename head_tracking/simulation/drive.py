"""The control loop of a simulated servo: turns settings into motion, one millisecond at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from head_tracking.dynamixel.conversions import decode_sign_magnitude
from head_tracking.dynamixel.models import ServoModel
from head_tracking.simulation.compliance import ComplianceLaw, Setpoint, Side, slope_ticks
from head_tracking.simulation.memory import RegisterMemory
from head_tracking.simulation.motion import Hand, Mechanics, Shaft, Temperature

STEP: Final = 1_000_000
"""Period of the servo's control loop, ns."""

_DT: Final = STEP * 1e-9
_DAMPING: Final = 0.17  # drive per rad/s; damping ratio 0.83 with the default slope (ours)
_GOVERNOR: Final = 4.0  # drive per rad/s above the moving speed (ours)


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """What the control loop needs to know from the registers.

    Attributes:
        torque: Whether the motor is powered.
        wheel: Drive of wheel mode, -1 to 1; None in joint mode.
        goal: Goal angle, rad.
        moving_speed: rad/s; 0 is no limit.
        law: Compliance.
    """

    torque: bool
    wheel: float | None
    goal: float
    moving_speed: float
    law: ComplianceLaw

    @classmethod
    def of(cls, memory: RegisterMemory, model: ServoModel) -> DriveSettings:
        """Read the settings from the registers."""
        unit = model.radians_per_tick
        speed = memory["Moving Speed"]
        endless = memory["CW Angle Limit"] == 0 and memory["CCW Angle Limit"] == 0

        def side(name: str) -> Side:
            slope = slope_ticks(memory[f"{name} Compliance Slope"])
            return Side(memory[f"{name} Compliance Margin"] * unit, slope * unit)

        return cls(
            torque=bool(memory["Torque Enable"]),
            wheel=decode_sign_magnitude(speed) / model.speed_maximum if endless else None,
            goal=(memory["Goal Position"] - model.center) * unit,
            moving_speed=speed * model.speed_unit,
            law=ComplianceLaw(
                clockwise=side("CW"),
                counterclockwise=side("CCW"),
                punch=memory["Punch"] / 1023.0,
                limit=memory["Torque Limit"] / 1023.0,
                damping=_DAMPING,
            ),
        )


class Drive:
    """Motor, gear, shaft and their control loop. Time is passed in, as ns that never fall.

    What happens depends on when settings change, rounded to `STEP`, and not on how often
    `advance` is called.

    Args:
        model: The servo's model.
        angle: Where the shaft stands at first, rad.
        settings: Settings at first.
        ambient_temperature: Degrees Celsius.

    Attributes:
        shaft: Angle and speed.
        temperature: Inside the servo.
        output: Drive of the last step, -1 to 1, counter-clockwise positive.
        at_rest: Whether nothing will move until something changes.
    """

    def __init__(
        self,
        model: ServoModel,
        angle: float,
        settings: DriveSettings,
        ambient_temperature: float,
    ) -> None:
        self.shaft = Shaft(Mechanics.of(model), angle)
        self.temperature = Temperature(ambient_temperature)
        self.output = 0.0
        self.at_rest = False
        self._settings = settings
        self._setpoint = Setpoint(angle)
        self._pushed = 0.0
        self._hand: Hand | None = None
        self._time: int | None = None

    def configure(self, settings: DriveSettings) -> None:
        """Use other settings from now on."""
        self._settings = settings
        self.at_rest = False

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
    def moving(self) -> bool:
        """Whether a goal is being approached."""
        settings = self._settings
        if not settings.torque:
            return False
        if settings.wheel is not None:
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
        heat, done = 0.0, 0
        while done < steps and not self.at_rest:
            heat += self._step(self._time + done * STEP, voltage) ** 2
            done += 1
        heat += (steps - done) * (self.output * voltage) ** 2
        self.temperature.heat(math.sqrt(heat / steps), steps * _DT)
        self._time += steps * STEP

    def _step(self, now: int, voltage: float) -> float:
        """Move on by one step and return the motor current, -1 to 1 of the stall current."""
        shaft, setpoint, settings = self.shaft, self._setpoint, self._settings
        before = (shaft.angle, shaft.speed, setpoint.angle)
        external = self._pushed
        if self._hand is not None:
            if self._hand.holds(now):
                external += self._hand.torque(shaft, now)
            else:
                self._hand = None
        current = 0.0
        powered = settings.torque and settings.law.limit > 0.0
        if powered and settings.wheel is None:
            self.output = self._approach()
        else:
            setpoint.follow(shaft.angle)
            limit = settings.law.limit if powered else 0.0
            self.output = max(-limit, min(limit, settings.wheel or 0.0))
        if powered:
            motor = self.output * voltage
            shaft.step(motor, external, _DT, settings.wheel is not None)
            current = motor - shaft.speed / shaft.mechanics.free_speed
        else:
            shaft.step(None, external, _DT, settings.wheel is not None)
        after = (shaft.angle, shaft.speed, setpoint.angle)
        self.at_rest = before == after and self._hand is None
        return current

    def _approach(self) -> float:
        """Return the drive that brings the shaft to the goal."""
        law, shaft, setpoint = self._settings.law, self.shaft, self._setpoint
        limit = self._settings.moving_speed
        side = self._side()
        lead = side.margin + side.slope
        setpoint.advance(self._settings.goal, limit, shaft.angle, lead, _DT)
        drive = law.drive(setpoint.angle - shaft.angle, shaft.speed - setpoint.speed)
        excess = abs(shaft.speed) - limit
        if limit > 0.0 and excess > 0.0:
            drive -= math.copysign(excess * _GOVERNOR, shaft.speed)
            drive = max(-law.limit, min(law.limit, drive))
        return drive

    def _side(self) -> Side:
        law = self._settings.law
        rising = self._settings.goal > self.shaft.angle
        return law.counterclockwise if rising else law.clockwise
