"""How a joint is wired: which servo drives it, where its zero is, how far and fast it may go."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from head_tracking.dynamixel.conversions import (
    decode_sign_magnitude,
    radians_to_ticks,
    speed_to_register,
    ticks_to_radians,
)
from head_tracking.dynamixel.exceptions import ConfigurationError, RangeError
from head_tracking.dynamixel.models import AX_12, ServoModel
from head_tracking.dynamixel.protocol1 import MAX_ID


@dataclass(frozen=True, slots=True)
class JointConfiguration:
    """One joint and its servo; converts between the servo's registers and the joint's SI units.

    The convention is dynamixel_motor's: position 0 rad is at tick `init`; `min` above `max` says
    that the servo is mounted the other way round, which turns the sign of position, velocity and
    load.

    Attributes:
        joint_name: The joint in the robot model.
        controller: Prefix of the joint's topics, such as head_pan_controller.
        id: Servo id, 0 to 253.
        init: Tick of position 0 rad.
        min: Tick of the lowest position.
        max: Tick of the highest position.
        joint_speed: Speed used when a command gives none, rad/s.
        max_speed: Highest speed ever asked of the servo, rad/s; None stands for the model's
            no-load speed. See `speed_limit`.
        model: The servo's model.

    Raises:
        ConfigurationError: A value is outside what the servo can do.
    """

    joint_name: str
    controller: str
    id: int
    init: int = 512
    min: int = 0
    max: int = 1023
    joint_speed: float = 2.0
    max_speed: float | None = None
    model: ServoModel = AX_12
    _sign: int = field(init=False, repr=False, compare=False)
    _radians_per_tick: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("joint_name", "controller"):
            text = getattr(self, name)
            if not isinstance(text, str) or not text.strip():
                raise ConfigurationError(f"{name} must be a name, not {text!r}")
        self._check_id()
        self._check_ticks()
        self._check_speeds()
        object.__setattr__(self, "_sign", -1 if self.reversed else 1)
        object.__setattr__(self, "_radians_per_tick", self.model.radians_per_tick)

    def _check_id(self) -> None:
        if not _is_integer(self.id) or not 0 <= self.id <= MAX_ID:
            raise ConfigurationError(
                f"{self.joint_name}: id {self.id!r} is no servo id; allowed are 0 to {MAX_ID}"
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

    def _check_speeds(self) -> None:
        fastest = self.model.speed_maximum * self.model.speed_unit
        for name in ("joint_speed", "max_speed"):
            speed = getattr(self, name)
            if speed is None and name == "max_speed":
                continue
            if not _is_number(speed) or not 0.0 < speed <= fastest:
                raise ConfigurationError(
                    f"{self.joint_name}: {name}: {speed!r} is not possible; allowed are speeds "
                    f"above 0 and up to {fastest:.2f} rad/s"
                )
        if self.joint_speed > self.speed_limit:
            raise ConfigurationError(
                f"{self.joint_name}: joint_speed: {self.joint_speed} is above the highest allowed "
                f"speed of {self.speed_limit:.2f} rad/s; lower joint_speed or raise max_speed"
            )

    @property
    def reversed(self) -> bool:
        """Whether rising ticks are falling positions."""
        return self.min > self.max

    @property
    def tick_range(self) -> tuple[int, int]:
        """Lowest and highest tick, whichever way round the servo is mounted."""
        return (self.max, self.min) if self.reversed else (self.min, self.max)

    @property
    def lower(self) -> float:
        """Lowest position, rad."""
        return self.position(self.min)

    @property
    def upper(self) -> float:
        """Highest position, rad."""
        return self.position(self.max)

    @property
    def resolution(self) -> float:
        """Angle of one tick, rad."""
        return self._radians_per_tick

    @property
    def speed_limit(self) -> float:
        """Highest speed ever asked of the servo, rad/s."""
        return self.model.no_load_speed if self.max_speed is None else self.max_speed

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
        """Return the joint's velocity, rad/s, from the Present Speed register."""
        return self._sign * decode_sign_magnitude(present_speed) * self.model.speed_unit

    def load(self, present_load: int) -> float:
        """Return the servo's output, -1 to 1 of its full torque, from the Present Load register.

        Positive when the servo drives towards higher positions.
        """
        return self._sign * decode_sign_magnitude(present_load) / self.model.load_maximum

    def speed_ticks(self, speed: float) -> int:
        """Return the Moving Speed value for a speed in rad/s, capped at `speed_limit`; never 0.

        Raises:
            RangeError: The speed is not a finite number above 0.
        """
        fastest = math.floor(self.speed_limit / self.model.speed_unit)
        maximum = min(self.model.speed_maximum, max(1, fastest))
        return speed_to_register(speed, self.model.speed_unit, maximum)


def check_configuration(joints: Iterable[JointConfiguration]) -> tuple[JointConfiguration, ...]:
    """Return the joints of one bus after checking them against each other.

    Raises:
        ConfigurationError: There is no joint, or two share an id, a name or a controller.
    """
    checked = tuple(joints)
    if not checked:
        raise ConfigurationError("no joint is configured; a bus needs at least one")
    keys: tuple[tuple[str, Callable[[JointConfiguration], object]], ...] = (
        ("id", lambda joint: joint.id),
        ("joint_name", lambda joint: joint.joint_name),
        ("controller", lambda joint: joint.controller),
    )
    for name, key in keys:
        first: dict[object, JointConfiguration] = {}
        for joint in checked:
            other = first.setdefault(key(joint), joint)
            if other is not joint:
                raise ConfigurationError(
                    f"{name} {key(joint)} is used twice, by {other.joint_name} and "
                    f"{joint.joint_name}; each joint of a bus needs its own"
                )
    return checked


def _is_integer(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
