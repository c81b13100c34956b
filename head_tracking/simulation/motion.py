"""The mechanics of a servo: a motor with its gear as one rigid rotor.

Numbers marked "ours" are plausible assumptions; the vendor publishes no dynamics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from head_tracking.dynamixel.models import ServoModel

TIME_CONSTANT: Final = 0.04
"""Time in which the unloaded rotor reaches 63 % of its final speed, s (ours)."""

_STICTION: Final = 0.028  # of the stall torque: a little under the AX punch of 32/1023 (ours)
_SLIDING: Final = 0.023  # Coulomb friction of the moving gear, of the stall torque (ours)
_FINE: Final = 0.3  # of that stiction have servos whose control law has no punch (ours)
_VISCOSITY: Final = 0.02  # of the back-EMF: what slows a shaft without power (ours)


@dataclass(frozen=True, slots=True)
class Mechanics:
    """Constants of a servo's drive train, seen at the output shaft.

    Attributes:
        stall_torque: At standstill with full drive, N m.
        free_speed: Speed at which the back-EMF equals full drive, rad/s. With friction the
            unloaded servo reaches its no-load speed.
        inertia: kg m^2.
        stiction: Torque up to which a standing shaft does not move, N m.
        sliding: Friction of the moving shaft, N m.
        lowest: Lower end stop, rad; -inf if it turns all round.
        highest: Upper end stop, rad; inf if it turns all round.
    """

    stall_torque: float
    free_speed: float
    inertia: float
    stiction: float
    sliding: float
    lowest: float
    highest: float

    @classmethod
    def of(cls, model: ServoModel) -> Mechanics:
        """Return the constants that give a model its no-load speed and stall torque."""
        stiction = _STICTION if "CW Compliance Slope" in model.control_table else _FINE * _STICTION
        lowest = -model.center * model.radians_per_tick
        highest = (model.ticks - model.center) * model.radians_per_tick
        return cls(
            stall_torque=model.stall_torque,
            free_speed=model.no_load_speed / (1.0 - _SLIDING),
            inertia=TIME_CONSTANT * model.stall_torque / model.no_load_speed,
            stiction=stiction * model.stall_torque,
            sliding=_SLIDING * model.stall_torque,
            lowest=-math.inf if model.endless else lowest,
            highest=math.inf if model.endless else highest,
        )


class Shaft:
    """Angle and speed of the output shaft.

    Attributes:
        angle: rad, counter-clockwise; 0 at the middle of the servo's range.
        speed: rad/s.
    """

    def __init__(self, mechanics: Mechanics, angle: float = 0.0) -> None:
        self.mechanics = mechanics
        self.angle = angle
        self.speed = 0.0

    def step(self, drive: float | None, external: float, dt: float, endless: bool = False) -> None:
        """Move on by one step.

        Args:
            drive: Voltage at the motor, -1 to 1 of the nominal supply; None leaves its wires open.
            external: Torque on the shaft from outside, N m.
            dt: Step, s.
            endless: Ignore the end stops and go round (wheel mode).
        """
        mechanics = self.mechanics
        back_emf = mechanics.stall_torque / mechanics.free_speed
        if drive is None:
            torque, resistance = external, _VISCOSITY * back_emf
        else:
            torque, resistance = external + drive * mechanics.stall_torque, back_emf
        if self.speed == 0.0 and abs(torque) <= mechanics.stiction:
            return
        rate = dt / mechanics.inertia
        speed = (self.speed + torque * rate) / (1.0 + resistance * rate)
        brake = mechanics.sliding * rate / (1.0 + resistance * rate)
        if abs(speed) <= brake or speed * self.speed < 0.0:
            speed = 0.0  # friction stops the shaft before it turns back
        else:
            speed -= math.copysign(brake, speed)
        self.speed = speed
        self.angle += speed * dt
        if endless:
            self.angle = math.remainder(self.angle, 2.0 * math.pi)
        elif not mechanics.lowest <= self.angle <= mechanics.highest:
            self.angle = max(mechanics.lowest, min(mechanics.highest, self.angle))
            self.speed = 0.0


@dataclass(frozen=True, slots=True)
class Hand:
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

    _STIFFNESS = 20.0  # N m / rad
    _DAMPING = 0.8  # N m s / rad
    _REST = 200_000_000  # ns it stays at the target before it lets go

    def holds(self, now: int) -> bool:
        """Return whether the hand is still on the shaft."""
        return now < self.start + self.duration + self._REST

    def torque(self, shaft: Shaft, now: int) -> float:
        """Return the torque on the shaft, N m."""
        way = min(1.0, (now - self.start) / self.duration) if self.duration else 1.0
        angle = self.origin + way * (self.target - self.origin)
        speed = (self.target - self.origin) / (self.duration * 1e-9) if way < 1.0 else 0.0
        torque = self._STIFFNESS * (angle - shaft.angle) + self._DAMPING * (speed - shaft.speed)
        return max(-self.strength, min(self.strength, torque))


class Temperature:
    """A slow thermal model: one heat capacity that cools to the surroundings (ours).

    Attributes:
        celsius: Temperature inside the servo.
    """

    _CAPACITY = 50.0  # J/K: 54.6 g of plastic, copper and steel
    _RESISTANCE = 10.0  # K/W to the surroundings
    _IDLE = 0.5  # W of the electronics
    _STALL = 18.0  # W at standstill with full drive: 1.5 A at 12 V

    def __init__(self, ambient: float) -> None:
        self._ambient = ambient
        self.celsius = ambient + self._IDLE * self._RESISTANCE

    def heat(self, current: float, seconds: float) -> None:
        """Pass some time.

        Args:
            current: Root mean square of the motor current in that time, 0 to 1 of the stall
                current.
            seconds: That time.
        """
        power = self._IDLE + self._STALL * current * current
        final = self._ambient + power * self._RESISTANCE
        decay = math.exp(-seconds / (self._CAPACITY * self._RESISTANCE))
        self.celsius = final + (self.celsius - final) * decay
