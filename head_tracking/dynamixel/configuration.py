"""How a joint is wired: which servos drive it, how far and fast it may go."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from head_tracking.dynamixel.exceptions import ConfigurationError
from head_tracking.dynamixel.models import AX_12, ServoModel
from head_tracking.dynamixel.mount import ServoMount


@dataclass(frozen=True, slots=True)
class JointConfiguration:
    """One joint and the servo that drives it, or two that do so together.

    See `ServoMount` for the meaning of ticks.

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
        second: The other servo of a joint that two of them drive.
        mount: The first servo, as it is mounted.

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
    second: ServoMount | None = None
    mount: ServoMount = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("joint_name", "controller"):
            text = getattr(self, name)
            if not isinstance(text, str) or not text.strip():
                raise ConfigurationError(f"{name} must be a name, not {text!r}")
        mount = ServoMount(self.joint_name, self.id, self.init, self.min, self.max, self.model)
        object.__setattr__(self, "mount", mount)
        self._check_speeds()

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
    def mounts(self) -> tuple[ServoMount, ...]:
        """The servos that drive the joint."""
        return (self.mount,) if self.second is None else (self.mount, self.second)

    @property
    def reversed(self) -> bool:
        """Whether rising ticks are falling positions."""
        return self.mount.reversed

    @property
    def tick_range(self) -> tuple[int, int]:
        """Lowest and highest tick, whichever way round the servo is mounted."""
        return self.mount.tick_range

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
        return self.mount.resolution

    @property
    def speed_limit(self) -> float:
        """Highest speed ever asked of the servos, rad/s."""
        slowest = min(mount.model.no_load_speed for mount in self.mounts)
        return slowest if self.max_speed is None else self.max_speed

    def position(self, ticks: float) -> float:
        """Return the joint's position, rad, at a tick; see `ServoMount.position`."""
        return self.mount.position(ticks)

    def ticks(self, position: float) -> int:
        """Return the tick next to a position in rad; see `ServoMount.ticks`."""
        return self.mount.ticks(position)

    def velocity(self, present_speed: int) -> float:
        """Return the joint's velocity, rad/s; see `ServoMount.velocity`."""
        return self.mount.velocity(present_speed)

    def load(self, present_load: int) -> float:
        """Return the servo's output, -1 to 1 of its full torque; see `ServoMount.load`."""
        return self.mount.load(present_load)

    def speed_ticks(self, speed: float) -> int:
        """Return the goal speed register, capped at `speed_limit`; see `ServoMount.speed_ticks`."""
        return self.mount.speed_ticks(speed, self.speed_limit)


def check_configuration(joints: Iterable[JointConfiguration]) -> tuple[JointConfiguration, ...]:
    """Return the joints of one bus after checking them against each other.

    Raises:
        ConfigurationError: There is no joint, or two share an id, a name or a controller.
    """
    checked = tuple(joints)
    if not checked:
        raise ConfigurationError("no joint is configured; a bus needs at least one")
    keys: tuple[tuple[str, Callable[[JointConfiguration], Iterable[object]]], ...] = (
        ("id", lambda joint: [mount.id for mount in joint.mounts]),
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
    return checked


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
