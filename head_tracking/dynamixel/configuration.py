"""How joints are wired, what the bus puts up with, and what servos shall keep in their memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import IntFlag

from head_tracking.dynamixel.exceptions import ConfigurationError, RangeError
from head_tracking.dynamixel.models import ServoModel, servo_model
from head_tracking.dynamixel.protocol import MAX_ID
from head_tracking.parameters import parameter


@dataclass(frozen=True, slots=True)
class ServoCalibration:
    """Where a servo's joint has its zero, in which direction it turns, and how far it may turn.

    The convention is dynamixel_motor's: position 0 rad is at tick `init`; `min` above `max` says
    that the servo is mounted the other way round, which turns the sign of position, velocity and
    load. Ticks become radians here and nowhere else.

    Attributes:
        joint_name: The joint in the robot model.
        id: Servo id, 0 to 253 (protocol 2.0: to 252).
        init: Tick of position 0 rad.
        min: Tick of the lowest position.
        max: Tick of the highest position.
        model: The servo's model.
        offset: What the servo's own memory added to its position, ticks, when this was measured;
            a servo with another offset is refused. None: it is not checked.
        reverse: Whether the servo's Drive Mode counted ticks in reverse when this was measured; a
            servo with another Drive Mode is refused. None: it is not checked.
        direction: -1 if rising ticks are falling positions, else 1.
        scale: What one tick more is for the joint's position, rad.
        lowest_turn: Lowest tick of the turn around the middle of the range. A servo whose scale
            goes round counts on beyond a turn while it is relaxed.

    Raises:
        ConfigurationError: A value is outside what the servo can do.
    """

    joint_name: str
    id: int
    init: int = 512
    min: int = 0
    max: int = 1023
    model: ServoModel = field(default_factory=lambda: servo_model("AX-12"))
    offset: int | None = None
    reverse: bool | None = None
    direction: int = field(init=False, repr=False, compare=False)
    scale: float = field(init=False, repr=False, compare=False)
    lowest_turn: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _check_name("joint_name", self.joint_name)
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

    def mirrored(self) -> tuple[int, int, int]:
        """Return what init, min and max are with the other direction of Drive Mode."""
        last = self.model.ticks - 1
        init, low, high = (
            min(last, 2 * self.model.center - tick) for tick in (self.init, self.min, self.max)
        )
        return init, low, high

    @property
    def tick_range(self) -> tuple[int, int]:
        """Lowest and highest tick, in whichever direction the servo turns."""
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
        """Return lowest and highest tick that this, its model and a servo's own limits allow.

        Raises:
            ConfigurationError: They have nothing in common.
        """
        (low, high), (lower, upper), (first, last) = (
            self.tick_range,
            own_range,
            self.model.goal_range,
        )
        lowest, highest = max(low, lower, first), min(high, upper, last)
        if lowest >= highest:
            raise ConfigurationError(
                f"{self.joint_name}: the configuration allows ticks {low} to {high}, servo "
                f"{self.id} itself {lower} to {upper}: nothing in common; correct min and max or "
                "the servo's angle limits"
            )
        return lowest, highest

    def position(self, ticks: float) -> float:
        """Return the joint's position, rad, at a tick (a simulated servo has fractions of one)."""
        return (ticks - self.init) * self.scale

    def ticks(self, position: float) -> int:
        """Return the tick next to a position in rad, also beyond the limits."""
        return round(self.init + position / self.scale)


def fastest_speed(model: ServoModel) -> float:
    """Return the highest speed, rad/s, that may be configured for a servo of that model.

    It is twice the no-load speed, if the goal speed's register can hold that.
    """
    return min(model.speed_maximum * model.speed_unit, 2.0 * model.no_load_speed)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointConfiguration(ServoCalibration):
    """One joint: the calibration of the servo that drives it, and perhaps of a second one.

    Attributes:
        controller: Prefix of the joint's topics, such as head_pan_controller.
        joint_speed: Speed used when a command gives none, rad/s; `speed_limit` reduces it.
        max_speed: Highest speed ever asked of the servo, rad/s; None stands for the model's
            no-load speed. See `speed_limit`.
        second: The other servo of a joint that two of them drive.

    Raises:
        ConfigurationError: A value is outside what the servo can do.
    """

    controller: str
    joint_speed: float = 2.0
    max_speed: float | None = None
    second: ServoCalibration | None = None

    def __post_init__(self) -> None:
        ServoCalibration.__post_init__(self)  # slots: super() would not find this class
        _check_name("controller", self.controller)
        fastest = fastest_speed(self.model)
        for name in ("joint_speed", "max_speed"):
            speed = getattr(self, name)
            if speed is None and name == "max_speed":
                continue
            if not _is_number(speed) or not 0.0 < speed <= fastest:
                raise ConfigurationError(
                    f"{self.joint_name}: {name}: {speed!r} is not possible; allowed are speeds "
                    f"above 0 and up to {fastest:.2f} rad/s"
                )

    @property
    def calibrations(self) -> tuple[ServoCalibration, ...]:
        """The servos that drive the joint."""
        return (self,) if self.second is None else (self, self.second)

    @property
    def speed_limit(self) -> float:
        """Highest speed ever asked of the servos, rad/s."""
        slowest = min(each.model.no_load_speed for each in self.calibrations)
        return slowest if self.max_speed is None else self.max_speed


def check_configuration(joints: Iterable[JointConfiguration]) -> tuple[JointConfiguration, ...]:
    """Return the joints of one bus after checking them against each other.

    Raises:
        ConfigurationError: There is no joint, two share an id, a name or a controller, or servos
            are of families that cannot be on one line.
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
            "take each other's packets for their own; give each family an adapter"
        )
    return checked


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Numbers that suit most robots.

    Attributes:
        retries: How often a failed read is repeated within the same cycle.
        lost_after: Failed cycles in a row after which a servo counts as lost.
        poll_interval: Time between two questions to a lost servo, s.
        reconnect_interval: Time between two looks for an adapter that has gone, s.
        command_timeout: Time after its last command at which a joint that is still under way holds
            where it is, s; 0: it goes on to its goal.
        watchdog: Time without any packet after which servos of the X series stop by themselves, s;
            0: never.
        warm: Temperature from which on a servo is worth a warning, degrees Celsius.
        hot: Temperature from which on it is an error.
        rest: Temperature from which on the joint is relaxed until its servo is no longer warm.

    Raises:
        ConfigurationError: A number makes no sense.
    """

    retries: int = 1
    lost_after: int = 5
    poll_interval: float = 0.04
    reconnect_interval: float = 0.2
    command_timeout: float = 0.0
    watchdog: float = 1.0
    warm: float = 60.0
    hot: float = 65.0
    rest: float = 68.0

    def __post_init__(self) -> None:
        allowed = (
            ("retries", self.retries >= 0, "at least 0"),
            ("lost_after", self.lost_after >= 1, "at least 1"),
            ("poll_interval", self.poll_interval > 0.0, "seconds above 0"),
            ("reconnect_interval", self.reconnect_interval > 0.0, "seconds above 0"),
            ("command_timeout", self.command_timeout >= 0.0, "0 or seconds above 0"),
            ("watchdog", 0.0 <= self.watchdog <= 2.5, "0 to 2.5 seconds"),
            ("hot", self.warm <= self.hot, f"at least warm, {self.warm} degrees"),
            ("rest", self.hot <= self.rest, f"at least hot, {self.hot} degrees"),
        )
        for name, possible, what in allowed:
            if not possible:
                raise ConfigurationError(
                    f"{name} {getattr(self, name)} is not possible; allowed are {what}"
                )


@dataclass(frozen=True, slots=True)
class EepromSettings:
    """What the service write_eeprom puts into the memory of the servos."""

    return_delay: float = parameter(
        0.0, "Time before a servo answers.", unit="microseconds", minimum=0.0, maximum=508.0
    )
    angle_limits: bool = parameter(True, "The servo itself refuses goals beyond min and max.")
    shutdown: tuple[str, ...] = parameter(
        (),
        "Errors upon which a servo switches itself off, such as overload and overheating; none: "
        "those that it has.",
    )
    status_return_level: int = parameter(
        2, "What a servo answers: 1 pings and reads, 2 everything.", minimum=1, maximum=2
    )

    def registers(self, model: ServoModel, tick_range: tuple[int, int]) -> dict[str, int]:
        """Return the register values for a servo, by name.

        Args:
            model: Its model.
            tick_range: Lowest and highest tick of its joint.

        Raises:
            ConfigurationError: The model has no such error, or a value is outside its register.
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


def _named_errors(model: ServoModel, names: tuple[str, ...]) -> list[IntFlag]:
    known = {(bit.name or "").lower().replace("_", " "): bit for bit in model.errors}
    for name in names:
        if name not in known:
            raise ConfigurationError(
                f"the {model.name} has no error {name!r}; it has {', '.join(known)}"
            )
    return [known[name] for name in names]


def _check_name(name: str, text: object) -> None:
    if not isinstance(text, str) or not text.strip():
        raise ConfigurationError(f"{name} must be a name, not {text!r}")


def _is_integer(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
