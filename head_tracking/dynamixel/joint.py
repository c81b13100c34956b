"""A joint as the bus keeps it: its servos, its limits, its goal, and the facts about its torque.

Relaxed on request, stopped, resting from heat, and shut down by itself (a fact of the servo) are
independent: whoever sets or clears one does not touch the others. `torque` sums them up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import IntFlag
from functools import reduce

from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import ConfigurationError, GoalError
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.servo import Changes, LinkState, Servo
from head_tracking.dynamixel.state import Goal, ServoState, Torque, check_speed


class Joint:
    """State of one joint. Only the thread that owns the bus changes it; any thread may look.

    Args:
        configuration: How the joint is wired.
        port: Where its servos are.
        watchdog: Time without any packet after which its servos shall stop, s; 0: never.
        changes: Of its bus.

    Attributes:
        name: The joint's name.
        configuration: How the joint is wired.
        servos: Its servo, or its two.
        on: Whether its goal is written and its servos hold it.
        relaxed: Whether somebody has relaxed it, until somebody switches its torque on.
        stopped: Whether it takes no part in the cycle, on request.
        resting: Whether it is relaxed to cool down.
        default_speed: Speed for goals that give none, rad/s.
        goal_ticks: What is written to its servos; () without a goal.
        goal_position: The same as a position of the joint, rad.
        goal_speed: Speed of the goal, rad/s; None: the default, 0: the slowest.
        commanded_at: Monotonic time, ns, of the goal; None without one, or for one that is held.
        share: The bytes of goal position and speed for each servo.
        stale: Whether they are to be made anew.
        busy: Whether steps are being taken that others must wait for.
        writing: Whether the memory of its servos is being written.
        overtaken: Counts who has relaxed it.
        resumes: Whether it was on when its servo was lost, and may be so again.
    """

    def __init__(
        self,
        configuration: JointConfiguration,
        port: DynamixelPort,
        watchdog: float = 0.0,
        changes: Changes | None = None,
    ) -> None:
        self._changes = changes or Changes()
        self.configuration = configuration
        self.name = configuration.joint_name
        self.servos = tuple(
            Servo(port, each.id, each.model, each, watchdog, self._changes)
            for each in configuration.calibrations
        )
        self.on = self.relaxed = self.stopped = self.resting = False
        self.default_speed = configuration.joint_speed
        self.goal_ticks: tuple[int, ...] = ()
        self.goal_position = 0.0
        self.goal_speed: float | None = None
        self.commanded_at: int | None = None
        self.share: tuple[bytes, ...] = ()
        self.stale = False
        self.busy = self.writing = False
        self._limit_speed()
        self.overtaken = 0
        self.resumes = False

    # What is known

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
        """Whether every servo of it answers, so that it can be commanded."""
        return not any([servo.lost for servo in self.servos])

    @property
    def writable(self) -> bool:
        """Whether goals may be written: none of its servos may have been without power since.

        Two servos get their goals together or not at all: they would tear at each other.
        """
        return all([servo.link is LinkState.PRESENT for servo in self.servos])

    @property
    def confirmed(self) -> bool:
        """Whether its servos have confirmed that they are relaxed, and are so since."""
        return all([servo.confirmed for servo in self.servos])

    @property
    def torque(self) -> Torque:
        """Why it holds or does not hold its position; the most pressing reason of several."""
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
        return self._common(*self.servos[0].limits)

    def _common(self, lower: float, upper: float) -> tuple[float, float]:
        """Return those of some limits of the first servo that the second one allows, too."""
        for servo in self.servos[1:]:
            lower, upper = max(lower, servo.limits[0]), min(upper, servo.limits[1])
        return lower, upper

    def range(self, servo: Servo) -> tuple[int, int]:
        """Return lowest and highest tick of a servo that the limits of the joint allow."""
        first, last = sorted(map(servo.calibration.ticks, self.limits))
        return first, last

    def admit(self, goal: Goal, clamp: bool) -> float:
        """Return the position to go to, rad, or refuse the goal. Changes nothing.

        Raises:
            GoalError: The goal is no number, outside the limits, or the joint takes no commands.
        """
        position, speed = goal.position, goal.speed
        if not -1e9 < position < 1e9:
            raise GoalError(
                f"{self.name}: goal position {position} refused; it must be a finite number of "
                "radians"
            )
        if speed is not None and not 0.0 < speed < 1e9:
            check_speed(self.name, speed)
        if not self.on:
            torque = self.torque
            if self.writing:
                raise GoalError(
                    f"{self.name}: command refused, the memory of its servo is being written; "
                    "command it again once that is done"
                )
            if torque.waits:
                controller = self.configuration.controller
                raise GoalError(f"{self.name} ({controller}): {torque.value}")
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
        """Return the joint's state from those of its servos that answered in this cycle."""
        servos = self.servos
        first = servos[0]
        load, voltage, temperature = first.load, first.voltage, first.temperature
        errors = first.errors
        if len(servos) > 1:
            answered = [servo for servo in servos if servo.answers]
            first = answered[0]
            load = sum(servo.load for servo in answered) / len(answered)
            voltage = min(servo.voltage for servo in answered)
            temperature = max(servo.temperature for servo in answered)
            errors = reduce(_both, [servo.errors for servo in answered])
        return ServoState(
            self.name,
            first.id,
            first.stamp,
            first.position,
            first.velocity,
            load,
            voltage,
            temperature,
            errors,
            self.on,
            self.goal_position if self.goal_ticks else None,
        )

    def set_stopped(self, stopped: bool) -> None:
        """Take it out of the cycle, or back."""
        self.stopped = stopped
        self._changes.count += 1

    # Owner's thread

    def aim(self, position: float, speed: float | None, now: int) -> None:
        """Make this the goal that is written from now on; `now` is monotonic, ns."""
        lower, upper = self.limits  # limits may have been narrowed since it was accepted
        position = min(max(position, lower), upper)
        ticks = tuple([servo.calibration.ticks(position) for servo in self.servos])
        self.goal_ticks, self.goal_speed, self.commanded_at = ticks, speed, now
        self.encode()

    def encode(self) -> None:
        """Make the bytes of goal position and speed anew."""
        self.stale = False
        speed = self.default_speed if self.goal_speed is None else self.goal_speed
        pairs = zip(self.servos, self.goal_ticks, strict=True)
        self.share = tuple([servo.encode_goal(ticks, speed) for servo, ticks in pairs])
        self.goal_position = self.servos[0].calibration.position(self.goal_ticks[0])

    def _limit_speed(self) -> None:
        for servo in self.servos:
            servo.limit_speed(self.configuration.speed_limit)

    def set_default_speed(self, speed: float) -> None:
        """Set the speed for goals that give none, rad/s, also for one under way.

        Raises:
            GoalError: It is not finite or not above 0.
        """
        check_speed(self.name, speed)
        self.default_speed = speed
        self.stale = True

    def forget_goal(self) -> None:
        """Drop the goal, so that nothing is written any more; torque is not on without one."""
        self.on = False
        self.goal_ticks = ()
        self.commanded_at = None

    def hold(self) -> None:
        """Make the position that was read last the goal, at the speed of the previous one."""
        self._aim_at([servo.ticks for servo in self.servos], self.goal_speed)

    def pinned(self, ticks: Sequence[int]) -> None:
        """Take note that its torque is on, and that these are the goals of its servos."""
        self._aim_at(ticks, 0.0)  # limits may have been narrowed meanwhile
        self.on, self.resumes = True, False

    def _aim_at(self, ticks: Sequence[int], speed: float | None, since: int | None = None) -> None:
        """Make ticks, moved into the limits of the joint, the goal that is written from now on."""
        goal = []
        for servo, each in zip(self.servos, ticks, strict=True):
            lowest, highest = self.range(servo)
            goal.append(max(lowest, min(highest, each)))
        self.goal_ticks, self.goal_speed, self.commanded_at = tuple(goal), speed, since
        self.encode()

    def lose(self) -> None:
        """Drop the goal, because nobody answers any more."""
        self.resumes = self.resumes or self.on
        self.forget_goal()

    def relax(self) -> None:
        """Drop its goal and whatever would switch its torque on; the servos are not told."""
        self.overtaken += 1
        self.resumes = False
        self.forget_goal()

    def reconfigure(
        self,
        lowest: int | None = None,
        highest: int | None = None,
        max_speed: float | None = None,
    ) -> None:
        """Take over other limits; None leaves one as it is. A goal outside moves inside.

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
            self._aim_at(self.goal_ticks, self.goal_speed, self.commanded_at)

    def reconfigured(
        self, lowest: int | None, highest: int | None, max_speed: float | None = None
    ) -> JointConfiguration:
        """Return the configuration with other limits; takes and raises what `reconfigure` does."""
        old = self.configuration
        new = replace(
            old,
            min=old.min if lowest is None else lowest,
            max=old.max if highest is None else highest,
            max_speed=old.max_speed if max_speed is None else max_speed or None,
        )
        if new.direction != old.direction:
            raise ConfigurationError(
                f"{self.name}: min {new.min} and max {new.max} would turn the joint's direction "
                f"round; min must stay {'above' if old.direction < 0 else 'below'} max while the "
                "bus runs. Set one that mounts the servo the other way round at the start"
            )
        first, last = sorted(map(new.position, new.within(self.servos[0].own_range)))
        self._require_range(*self._common(first, last))
        return new

    def require_range(self) -> None:
        """Raise ConfigurationError if its two servos allow no position in common."""
        self._require_range(*self.limits)

    def _require_range(self, lower: float, upper: float) -> None:
        if lower >= upper:
            raise ConfigurationError(
                f"{self.name}: its two servos allow no position in common, one no less than "
                f"{lower:.3f} rad, one no more than {upper:.3f} rad; correct min and max, or the "
                "servos' own angle limits"
            )


def _both(one: IntFlag, other: IntFlag) -> IntFlag:
    return one | other if type(one) is type(other) else one or other
