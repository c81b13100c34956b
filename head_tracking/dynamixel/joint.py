"""A joint of the bus: its servos, limits, goal, and the state of its torque.

A joint may be relaxed on request, stopped, resting from heat, or shut down by itself. These facts
are independent of each other; `torque` is the most important one of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import ConfigurationError, GoalError
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.servo import LinkState, Servo, Version
from head_tracking.dynamixel.state import Goal, ServoState, Torque, check_speed


class BusJoint:
    """State of one joint. Only the thread that owns the bus changes it; any thread may read it.

    Args:
        watchdog: Time without any packet after which its servos shall stop, s; 0: never.
    """

    def __init__(
        self,
        configuration: JointConfiguration,
        port: DynamixelPort,
        watchdog: float = 0.0,
        version: Version | None = None,
    ) -> None:
        self.configuration = configuration
        self.name = configuration.joint_name
        self.servos = tuple(
            Servo(port, each.id, each.model, each, watchdog, version)
            for each in configuration.calibrations
        )
        self.relaxed = False  # on request, until torque is switched on
        self.stopped = False  # out of the cycle on request
        self.resting = False  # relaxed to cool down
        self.resumes = False  # it was on when its servo was lost, and may be again
        self.busy = False  # a procedure is running for the joint
        self.writing = False  # the memory of its servos is being written

        self.default_speed = configuration.joint_speed  # for goals without a speed, rad/s
        self.goal_ticks: tuple[int, ...] = ()  # of each servo; () while its torque is off
        self.goal_position = 0.0  # of the joint, rad
        self.goal_speed: float | None = None  # rad/s; None: the default, 0: the slowest
        self.commanded_at: int | None = None  # monotonic, ns; None: no goal, or a held position
        self._limit_speed()

    @property
    def on(self) -> bool:
        """Whether its torque is on; it has a goal then."""
        return bool(self.goal_ticks)

    @property
    def faulted(self) -> bool:
        """Whether a servo of it has shut itself down."""
        return any([servo.faulted for servo in self.servos])

    @property
    def lost(self) -> bool:
        """Whether no servo of it answers."""
        return all([servo.lost for servo in self.servos])

    @property
    def complete(self) -> bool:
        """Whether every servo of it answers."""
        return LinkState.LOST not in [servo.link for servo in self.servos]

    @property
    def writable(self) -> bool:
        """Whether goals may be written: every servo answers and has not lost its power.

        Two servos get their goals together or not at all; otherwise they would work against each
        other.
        """
        return all([servo.link is LinkState.PRESENT for servo in self.servos])

    @property
    def confirmed(self) -> bool:
        """Whether its servos have confirmed torque off, and are relaxed since."""
        return all([servo.confirmed for servo in self.servos])

    @property
    def torque(self) -> Torque:
        """Why it holds or does not hold its position."""
        if self.on:
            return Torque.ON
        if self.stopped:
            return Torque.OFF_STOPPED
        if self.faulted:
            return Torque.OFF_BY_FAULT
        if self.relaxed:
            return Torque.OFF_ON_REQUEST
        return Torque.OFF_TO_COOL if self.resting else Torque.OFF_UNTIL_COMMANDED

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest position, rad, allowed by configuration and servos."""
        servos = self.servos
        return servos[0].limits if len(servos) == 1 else self._common(*servos[0].limits)

    def _common(self, lower: float, upper: float) -> tuple[float, float]:
        """Return the part of the limits of the first servo that the second one allows."""
        for servo in self.servos[1:]:
            lower, upper = max(lower, servo.limits[0]), min(upper, servo.limits[1])
        return lower, upper

    def range(self, servo: Servo) -> tuple[int, int]:
        """Return lowest and highest tick of a servo within the limits of the joint."""
        first, last = sorted(map(servo.calibration.ticks, self.limits))
        return first, last

    @property
    def refusal(self) -> str:
        """Why its torque must stay off, so that it accepts no goals; empty: it need not."""
        if self.writing:
            return "the memory of its servo is being written; command it again after that"
        return self.torque.value if self.torque.refuses else ""

    def admit(self, goal: Goal, clamp: bool) -> float:
        """Return the position of an admissible goal, rad.

        Raises:
            GoalError: The goal is not finite or outside the limits.
        """
        position, speed = goal.position, goal.speed
        if not -1e9 < position < 1e9:
            raise GoalError(
                f"{self.name}: goal position {position} refused; it must be a finite number of "
                "radians"
            )
        if speed is not None and not 0.0 < speed < 1e9:
            check_speed(self.name, speed)
        lower, upper = self.limits
        if lower <= position <= upper:
            return position
        inside = min(max(position, lower), upper)
        if not clamp and abs(position - inside) > self.configuration.resolution:
            raise GoalError(
                f"{self.name}: goal position {position:.4f} rad refused; allowed are {lower:.4f} "
                f"to {upper:.4f} rad"
            )
        return inside

    def state(self) -> ServoState:
        """Return the joint's state, by its first servo that answered in this cycle."""
        first = self.servos[0]
        if len(self.servos) > 1:
            first = next(servo for servo in self.servos if servo.answers)
        goal = self.goal_position if self.goal_ticks else None
        return ServoState(first.stamp, first.position, first.velocity, goal)

    # Thread that owns the bus

    def aim(self, position: float, speed: float | None, now: int | None) -> None:
        """Set the goal, moved into the limits; `now` is monotonic, ns, or None: no command."""
        lower, upper = self.limits  # they may have been narrowed since the goal was admitted
        position = min(max(position, lower), upper)
        self.goal_ticks = tuple([servo.calibration.ticks(position) for servo in self.servos])
        self.goal_position = self.servos[0].calibration.position(self.goal_ticks[0])
        self.goal_speed, self.commanded_at = speed, now

    def _limit_speed(self) -> None:
        for servo in self.servos:
            servo.limit_speed(self.configuration.speed_limit)

    def set_default_speed(self, speed: float) -> None:
        """Set the speed for goals without a speed, rad/s, also for the present one.

        Raises:
            GoalError: It is not finite or not above 0.
        """
        check_speed(self.name, speed)
        self.default_speed = speed

    def hold(self) -> None:
        """Make the measured position the goal, at the speed of the previous goal."""
        there = [servo for servo in self.servos if servo.answers] or self.servos
        self._aim_between(there, [servo.ticks for servo in there], self.goal_speed)

    def pinned(self, ticks: Sequence[int]) -> None:
        """Record that its torque is on, with these goals of its servos, in ticks.

        Two servos that were pinned while the joint moved would push against each other: both get a
        position between.
        """
        self._aim_between(self.servos, ticks, 0.0)
        self.resumes = False

    def _aim_between(
        self, servos: Sequence[Servo], ticks: Sequence[int], speed: float | None
    ) -> None:
        positions = [s.calibration.position(each) for s, each in zip(servos, ticks, strict=True)]
        self.aim(sum(positions) / len(positions), speed, None)

    def drop_goal(self, resumes: bool = False) -> None:
        """Drop the goal; it `resumes` if it was on when its servos were lost."""
        self.resumes = resumes and (self.resumes or self.on)
        self.goal_ticks = ()

    def reconfigure(
        self,
        lowest: int | None = None,
        highest: int | None = None,
        max_speed: float | None = None,
    ) -> None:
        """Set other limits; None keeps one. A goal outside is moved inside.

        Args:
            lowest: `min` of the first servo, ticks.
            highest: `max` of the first servo, ticks.
            max_speed: Highest speed, rad/s; 0 for the model's own.

        Raises:
            ConfigurationError: The servo cannot do that; nothing has changed.
        """
        new = self.reconfigured(lowest, highest, max_speed)
        self.servos[0].calibrate(new)
        self.configuration = new
        self._limit_speed()
        if self.goal_ticks:
            self.aim(self.goal_position, self.goal_speed, self.commanded_at)

    def reconfigured(
        self, lowest: int | None, highest: int | None, max_speed: float | None = None
    ) -> JointConfiguration:
        """Return the configuration with other limits; as `reconfigure`."""
        old = self.configuration
        new = replace(
            old,
            min=old.min if lowest is None else lowest,
            max=old.max if highest is None else highest,
            max_speed=old.max_speed if max_speed is None else max_speed or None,
        )
        if new.direction != old.direction:
            raise ConfigurationError(
                f"{self.name}: min {new.min} and max {new.max} would reverse the joint's direction;"
                f" min must stay {'above' if old.direction < 0 else 'below'} max while the bus runs"
            )
        first, last = sorted(map(new.position, new.within(self.servos[0].own_range)))
        self._require_range(*self._common(first, last))
        return new

    def require_range(self) -> None:
        """Raise ConfigurationError if its two servos allow no common position."""
        self._require_range(*self.limits)

    def _require_range(self, lower: float, upper: float) -> None:
        if lower >= upper:
            raise ConfigurationError(
                f"{self.name}: its two servos allow no common position, one at least {lower:.3f} "
                f"rad, one at most {upper:.3f} rad; correct min and max, or the servos' own angle "
                "limits"
            )


def bus_joints(
    configurations: Iterable[JointConfiguration],
    port: DynamixelPort,
    watchdog: float = 0.0,
    version: Version | None = None,
) -> dict[str, BusJoint]:
    """Return the joints of a bus by name, with servos that know which others have other goals."""
    found = {each.joint_name: BusJoint(each, port, watchdog, version) for each in configurations}
    goals = {
        servo: (joint.name, servo.calibration.init, servo.calibration.scale)
        for joint in found.values()
        for servo in joint.servos
    }
    for servo, own in goals.items():
        servo.others = {other.id for other, goal in goals.items() if goal != own}
    return found
