"""How a servo is mounted: where its joint's zero is and which way round it turns."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from head_tracking.dynamixel.control_table import decode_sign_magnitude
from head_tracking.dynamixel.exceptions import ConfigurationError, RangeError
from head_tracking.dynamixel.models import AX_12, ServoModel
from head_tracking.dynamixel.protocol import MAX_ID


@dataclass(frozen=True, slots=True)
class ServoMount:
    """A servo on its joint; converts between its registers and the joint's SI units.

    The convention is dynamixel_motor's: position 0 rad is at tick `init`; `min` above `max` says
    that the servo is mounted the other way round, which turns the sign of position, velocity and
    load.

    Attributes:
        joint_name: The joint, for messages.
        id: Servo id, 0 to 253 (protocol 2.0: to 252).
        init: Tick of position 0 rad.
        min: Tick of the lowest position.
        max: Tick of the highest position.
        model: The servo's model.
        reversed: Whether rising ticks are falling positions.

    Raises:
        ConfigurationError: A value is outside what the servo can do.
    """

    joint_name: str
    id: int
    init: int
    min: int
    max: int
    model: ServoModel = AX_12
    reversed: bool = field(init=False, repr=False, compare=False)
    _sign: int = field(init=False, repr=False, compare=False)
    _radians_per_tick: float = field(init=False, repr=False, compare=False)
    _lowest_turn: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._check_id()
        self._check_ticks()
        object.__setattr__(self, "reversed", self.min > self.max)
        object.__setattr__(self, "_sign", -1 if self.min > self.max else 1)
        object.__setattr__(self, "_radians_per_tick", self.model.radians_per_tick)
        middle = (self.min + self.max + 1) // 2
        object.__setattr__(self, "_lowest_turn", middle - self.model.ticks // 2)

    def _check_id(self) -> None:
        highest = MAX_ID[self.model.protocol]
        if not _is_integer(self.id) or not 0 <= self.id <= highest:
            raise ConfigurationError(
                f"{self.joint_name}: id {self.id!r} is no servo id; allowed are 0 to {highest}"
            )

    def _check_ticks(self) -> None:
        last = self.model.ticks - 1
        for name in ("init", "min", "max"):
            tick = getattr(self, name)
            if not _is_integer(tick):
                raise ConfigurationError(
                    f"{self.joint_name}: {name} must be a whole number of ticks, not {tick!r}"
                )
            if not 0 <= tick <= last:
                raise ConfigurationError(
                    f"{self.joint_name}: {name}: {tick} is outside the {self.model.name}'s range; "
                    f"allowed are ticks 0 to {last}; use {0 if tick < 0 else last} for the end "
                    "of the range"
                )
        if self.min == self.max:
            raise ConfigurationError(
                f"{self.joint_name}: min and max are both {self.min}, so the joint could not move"
            )
        low, high = self.tick_range
        if not low <= self.init <= high:
            raise ConfigurationError(
                f"{self.joint_name}: init: {self.init} is not between min: {self.min} and "
                f"max: {self.max}; position 0 must be inside the joint's range"
            )

    @property
    def tick_range(self) -> tuple[int, int]:
        """Lowest and highest tick, whichever way round the servo is mounted."""
        return (self.max, self.min) if self.min > self.max else (self.min, self.max)

    @property
    def resolution(self) -> float:
        """Angle of one tick, rad."""
        return self._radians_per_tick

    def fold(self, ticks: int) -> int:
        """Return the tick in the turn around the joint's range that is the same angle.

        Servos with an endless range count on beyond a turn while they are relaxed.
        """
        if not self.model.endless:
            return ticks
        return (ticks - self._lowest_turn) % self.model.ticks + self._lowest_turn

    def position(self, ticks: float) -> float:
        """Return the joint's position, rad, at a tick (a simulated servo has fractions of one)."""
        return self._sign * ticks_to_radians(ticks, self.init, self._radians_per_tick)

    def ticks(self, position: float) -> int:
        """Return the tick next to a position in rad; inverse of `position`.

        Raises:
            RangeError: The position is not finite or outside the servo's range.
        """
        tick = round(radians_to_ticks(self._sign * position, self.init, self._radians_per_tick))
        if not 0 <= tick < self.model.ticks:
            ends = sorted((self.position(0), self.position(self.model.ticks - 1)))
            raise RangeError(
                f"{self.joint_name} cannot be at {position:.4f} rad; the servo's range is "
                f"{ends[0]:.4f} to {ends[1]:.4f} rad"
            )
        return tick

    def velocity(self, present_speed: int) -> float:
        """Return the joint's velocity, rad/s, from the Present Speed or Velocity register."""
        if self.model.sign_magnitude:
            present_speed = decode_sign_magnitude(present_speed)
        return self._sign * present_speed * self.model.speed_unit

    def load(self, present_load: int) -> float:
        """Return the servo's output, -1 to 1 of its full torque, from its load or current register.

        Positive when the servo drives towards higher positions.
        """
        if self.model.sign_magnitude:
            present_load = decode_sign_magnitude(present_load)
        return self._sign * present_load / self.model.load_maximum

    def speed_ticks(self, speed: float, limit: float) -> int:
        """Return the goal speed register for a speed, capped at a limit, both rad/s; never 0.

        Raises:
            RangeError: The speed is not a finite number above 0.
        """
        fastest = math.floor(limit / self.model.speed_unit)
        maximum = min(self.model.speed_maximum, max(1, fastest))
        return speed_to_register(speed, self.model.speed_unit, maximum)


def _is_integer(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def ticks_to_radians(ticks: float, zero: float, radians_per_tick: float) -> float:
    """Return the angle of a tick, in rad, counter-clockwise from the tick `zero`."""
    return (ticks - zero) * radians_per_tick


def radians_to_ticks(angle: float, zero: float, radians_per_tick: float) -> float:
    """Return the (unrounded) tick of an angle in rad; inverse of `ticks_to_radians`.

    Raises:
        RangeError: The angle is not a finite number.
    """
    if not math.isfinite(angle):
        raise RangeError(f"an angle of {angle} has no tick; it must be a finite number of radians")
    return zero + angle / radians_per_tick


def speed_to_register(speed: float, unit: float, maximum: int) -> int:
    """Return the Moving Speed value next to `speed` (rad/s), from 1 to `maximum`.

    Never 0: in joint mode 0 stands for full speed.

    Args:
        speed: Wanted speed, rad/s, above 0.
        unit: Speed of one count, rad/s.
        maximum: Highest value of the register.

    Raises:
        RangeError: The speed is not a finite number above 0.
    """
    if not (math.isfinite(speed) and speed > 0.0):
        raise RangeError(f"a speed of {speed} rad/s is not possible; it must be finite and above 0")
    return max(1, min(maximum, round(speed / unit)))
