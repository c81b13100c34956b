"""Configuration of joints, of the bus, and of the memory of servos."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import IntFlag
from typing import Any

from head_tracking.dynamixel.exceptions import ConfigurationError, RangeError
from head_tracking.dynamixel.models import ServoModel, servo_model
from head_tracking.dynamixel.protocol import MAX_ID
from head_tracking.parameters import parameter


@dataclass(frozen=True, slots=True)
class ServoCalibration:
    """Zero, direction and range of a servo's joint: the only conversion of ticks and radians.

    As in dynamixel_motor, position 0 rad is at tick `init`, and `min` above `max` reverses the
    direction, which changes the sign of position, velocity and load.

    Raises:
        ConfigurationError: A value is outside what the servo can do.
    """

    joint_name: str  # the joint in the robot model
    id: int  # servo id, 0 to 253 (protocol 2.0: to 252)
    init: int = 512  # tick of position 0 rad
    min: int = 0  # tick of the lowest position
    max: int = 1023  # tick of the highest position
    model: ServoModel = field(default_factory=lambda: servo_model("AX-12"))
    # Position offset in the servo's memory, ticks; a servo with another one is refused. None:
    # do not check it.
    offset: int | None = None
    # Whether Drive Mode reverses ticks; a servo that does not fit is refused. None: do not
    # check it.
    reverse: bool | None = None
    # -1 if the direction is reversed, otherwise 1
    direction: int = field(init=False, repr=False, compare=False)
    # Change of the joint's position with one tick, rad
    scale: float = field(init=False, repr=False, compare=False)
    # Lowest tick of the turn around the middle of the range, for servos that count on beyond
    # a turn while they are relaxed
    lowest_turn: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _check_name("joint_name", self.joint_name)
        if not isinstance(self.model, ServoModel):
            raise ConfigurationError(
                f"{self.joint_name}: model is {self.model!r}; give a model of a servo, such as "
                "servo_model('XL430-W250')"
            )
        last = self.model.ticks - 1
        limits = (("id", MAX_ID[self.model.protocol]), ("init", last), ("min", last), ("max", last))
        for name, highest in limits:
            value = getattr(self, name)
            if not _is_integer(value) or not 0 <= value <= highest:
                raise ConfigurationError(
                    f"{self.joint_name}: {name}: {value!r} is not possible for an "
                    f"{self.model.name}; allowed are whole numbers from 0 to {highest}"
                )
        if self.offset is not None:
            self._check_offset(self.offset)
        if self.reverse is not None and "Drive Mode" not in self.model.modes:
            raise ConfigurationError(
                f"{self.joint_name}: an {self.model.name} has no Drive Mode; leave reverse out"
            )
        low, high = self.tick_range
        if low == high or not low <= self.init <= high:
            raise ConfigurationError(
                f"{self.joint_name}: min: {self.min} and max: {self.max} are not possible with "
                f"init: {self.init}; they must differ, and init, position 0, must lie between them"
            )
        object.__setattr__(self, "direction", -1 if self.min > self.max else 1)
        object.__setattr__(self, "scale", self.direction * self.resolution)
        middle = (self.min + self.max + 1) // 2
        object.__setattr__(self, "lowest_turn", middle - self.model.ticks // 2)

    def _check_offset(self, offset: int) -> None:
        register = self.model.offset
        if register is None:
            raise ConfigurationError(
                f"{self.joint_name}: an {self.model.name} adds no offset to its position; leave "
                "offset out"
            )
        try:
            if not _is_integer(offset) or not register.admits(register.from_counts(offset)):
                raise RangeError(f"allowed are {register.minimum} to {register.maximum}")
        except RangeError as cause:
            raise ConfigurationError(
                f"{self.joint_name}: offset: {offset!r} is not possible for the {register.name} of "
                f"an {self.model.name}: {cause}"
            ) from cause

    @property
    def tick_range(self) -> tuple[int, int]:
        """Lowest and highest tick."""
        return (self.max, self.min) if self.min > self.max else (self.min, self.max)

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
        return self.model.radians_per_tick

    def within(self, own_range: tuple[int, int]) -> tuple[int, int]:
        """Return lowest and highest tick within a servo's own limits, `own_range`.

        Raises:
            ConfigurationError: There is none.
        """
        (low, high), (lower, upper), margin = self.tick_range, own_range, self.model.goal_margin
        lowest, highest = max(low, lower, margin), min(high, upper, self.model.ticks - 1 - margin)
        if lowest >= highest:
            raise ConfigurationError(
                f"{self.joint_name}: the configuration allows ticks {low} to {high}, servo "
                f"{self.id} itself {lower} to {upper}: nothing in common; correct min and max or "
                "the servo's angle limits"
            )
        return lowest, highest

    def position(self, ticks: float) -> float:
        """Return the joint's position, rad, at a tick."""
        return (ticks - self.init) * self.scale

    def ticks(self, position: float) -> int:
        """Return the nearest tick to a position in rad."""
        return round(self.init + position / self.scale)


def fastest_speed(model: ServoModel) -> float:
    """Return the highest speed to configure, rad/s: twice the no-load speed, if it fits."""
    return min(model.speed_maximum * model.speed_unit, 2.0 * model.no_load_speed)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointConfiguration(ServoCalibration):
    """One joint, driven by one servo or two.

    Raises:
        ConfigurationError: A value is outside what the servo can do.
    """

    controller: str  # prefix of the joint's topics, such as head_pan_controller
    joint_speed: float = 2.0  # speed of commands without a speed, rad/s
    max_speed: float | None = None  # highest goal speed, rad/s; None: the model's no-load speed
    second: ServoCalibration | None = None

    def __post_init__(self) -> None:
        ServoCalibration.__post_init__(self)  # slots: super() would not find this class
        _check_name("controller", self.controller)
        fastest = fastest_speed(self.model)
        for name in ("joint_speed", "max_speed"):
            speed = getattr(self, name)
            if speed is None and name == "max_speed":
                continue
            is_number = isinstance(speed, (int, float)) and not isinstance(speed, bool)
            if not (is_number and 0.0 < speed <= fastest):
                raise ConfigurationError(
                    f"{self.joint_name}: {name}: {speed!r} is not possible; allowed are speeds "
                    f"above 0 and up to {fastest:.2f} rad/s"
                )

    @property
    def calibrations(self) -> tuple[ServoCalibration, ...]:
        """The calibration of each servo of the joint."""
        return (self,) if self.second is None else (self, self.second)

    @property
    def speed_limit(self) -> float:
        """Highest goal speed, rad/s."""
        slowest = min(each.model.no_load_speed for each in self.calibrations)
        return slowest if self.max_speed is None else self.max_speed


def check_configuration(joints: Iterable[JointConfiguration]) -> tuple[JointConfiguration, ...]:
    """Check the joints of one bus against each other and return them.

    Raises:
        ConfigurationError: There is no joint, two share an id, a name or a controller, or servos
            of different families are on one line.
    """
    checked = tuple(joints)
    if not checked:
        raise ConfigurationError("no joint is configured; a bus needs at least one")
    keys: tuple[tuple[str, Callable[[JointConfiguration], Iterable[object]]], ...] = (
        ("id", lambda joint: [each.id for each in joint.calibrations]),
        ("joint_name", lambda joint: [joint.joint_name]),
        ("controller", lambda joint: [joint.controller]),
    )
    for name, values in keys:
        users: dict[object, JointConfiguration] = {}
        for joint in checked:
            for value in values(joint):
                if value in users:
                    raise ConfigurationError(
                        f"{name} {value} is used twice, by {users[value].joint_name} and "
                        f"{joint.joint_name}; each servo and joint of a bus needs its own"
                    )
                users[value] = joint
    families = {each.model.family for joint in checked for each in joint.calibrations}
    if len(families) > 1:
        raise ConfigurationError(
            f"servos of the families {', '.join(sorted(families))} cannot be on one bus: they "
            "obey each other's packets; give each family an adapter"
        )
    return checked


def _temperature(default: float, description: str) -> Any:
    return parameter(
        default, description, unit="degrees Celsius", minimum=0.0, maximum=100.0, fixed=True
    )


@dataclass(frozen=True, slots=True)
class TemperatureParameters:
    """Temperature limits; the limit of the factory is 65 to 80 degrees.

    Raises:
        ConfigurationError: They are not in ascending order, from 0 to 100.
    """

    warn: float = _temperature(60.0, "Reported as a warning.")
    error: float = _temperature(65.0, "Reported as an error.")
    rest: float = _temperature(68.0, "The joint is relaxed until it is cooler than the warning.")

    def __post_init__(self) -> None:
        if not 0.0 <= self.warn <= self.error <= self.rest <= 100.0:
            raise ConfigurationError(
                f"temperature.warn, .error and .rest are {self.warn:g}, {self.error:g} and "
                f"{self.rest:g} degrees; each must be at least the one before, from 0 to 100"
            )


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Settings of a bus; the defaults suit most robots."""

    # Time without a command after which a moving joint holds, s; 0: never.
    command_timeout: float = 0.0
    # Time without any packet after which X servos stop by themselves, at most 2.5 s; 0: never.
    watchdog: float = 1.0
    temperature: TemperatureParameters = TemperatureParameters()


@dataclass(frozen=True, slots=True)
class EepromSettings:
    """Settings that the service write_eeprom writes into the memory of the servos."""

    return_delay: float = parameter(
        0.0, "Time before a servo answers.", unit="microseconds", minimum=0.0, maximum=508.0
    )
    angle_limits: bool = parameter(True, "The servo itself refuses goals beyond min and max.")
    shutdown: tuple[str, ...] = parameter(
        (),
        "Errors that make a servo switch itself off, such as overload and overheating; none: keep "
        "those of the servo.",
    )
    status_return_level: int = parameter(
        2, "Instructions that a servo answers: 1 ping and read, 2 all.", minimum=1, maximum=2
    )

    def registers(self, model: ServoModel, tick_range: tuple[int, int]) -> dict[str, int]:
        """Return the register values for a model and the tick range of a joint, by name.

        Raises:
            ConfigurationError: The model has no such error, or a value is out of range.
        """
        wanted: dict[str, int] = {}
        table = model.control_table
        if "Return Delay Time" in table:
            register = table["Return Delay Time"]
            wanted[register.name] = register.from_unit(self.return_delay)
        if self.angle_limits:
            wanted.update(zip(model.position_limits, tick_range, strict=True))
        if self.shutdown:
            wanted["Shutdown"] = sum(_named_errors(model, self.shutdown))
        highest = table["Status Return Level"].maximum or 0  # Feetech has no level for pings
        wanted["Status Return Level"] = self.status_return_level - 2 + highest
        for name, value in wanted.items():
            if not table[name].admits(value):
                raise ConfigurationError(
                    f"{name} of the {model.name} cannot be {value}; allowed are "
                    f"{table[name].minimum} to {table[name].maximum}"
                )
        return wanted


def _named_errors(model: ServoModel, names: tuple[str, ...]) -> set[IntFlag]:
    known = {(bit.name or "").lower().replace("_", " "): bit for bit in model.errors}
    for name in names:
        if name not in known:
            raise ConfigurationError(
                f"the {model.name} has no error {name!r}; it has {', '.join(known)}"
            )
    return {known[name] for name in names}


def _check_name(name: str, text: object) -> None:
    if not isinstance(text, str) or not text.strip():
        raise ConfigurationError(f"{name} must be a name, not {text!r}")


def _is_integer(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
