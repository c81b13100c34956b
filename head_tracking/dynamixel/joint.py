"""A joint as the bus keeps it: its servos, its limits, its goal, and the facts about its torque.

Relaxed on request, stopped, resting from heat, and shut down by itself (a fact of the servo) are
independent: whoever sets or clears one does not touch the others. `torque` sums them up.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from enum import IntFlag
from functools import reduce

from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    DynamixelError,
    GoalError,
    ServoError,
)
from head_tracking.dynamixel.holding import pin
from head_tracking.dynamixel.maintenance import recover
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.relaxing import relaxing, release
from head_tracking.dynamixel.requests import Steps
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
        self._port = port
        self._overtaken = 0  # counts who relaxed or stopped it
        self._resumes = False  # it was on when its servo was lost, and may be so again

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

    def _inside(self, servo: Servo, ticks: int) -> int:
        """Return the tick moved into the limits of the joint."""
        lowest, highest = self._range(servo)
        return max(lowest, min(highest, ticks))

    def _range(self, servo: Servo) -> tuple[int, int]:
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

    # Owner's thread. Everything that talks to servos raises PortLostError when the port has gone.

    def aim(self, position: float, speed: float | None, now: int) -> None:
        """Make this the goal that is written from now on; `now` is monotonic, ns."""
        lower, upper = self.limits  # limits may have been narrowed since it was accepted
        position = min(max(position, lower), upper)
        ticks = tuple([servo.calibration.ticks(position) for servo in self.servos])
        self._set_goal(ticks, speed, now)

    def _set_goal(self, ticks: tuple[int, ...], speed: float | None, since: int | None) -> None:
        self.goal_ticks = ticks
        self.commanded_at = since
        self.goal_speed = speed
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

    def keep_goal(self) -> None:
        """Hold the goal from now on, because it has been reached."""
        self.commanded_at = None

    def hold(self, retries: int) -> None:
        """Make the present position the goal, if it is on, at the speed of the previous one.

        A servo that does not answer gets the position that was read last.
        """
        if not self.on:
            return
        for servo in self.servos:
            with suppress(CommunicationError):
                if servo.answers:
                    servo.read_feedback(1 + retries)
        self.hold_last()

    def hold_last(self) -> None:
        """Make the position that was read last the goal, at the speed of the previous one."""
        ticks = tuple([self._inside(servo, servo.ticks) for servo in self.servos])
        self._set_goal(ticks, self.goal_speed, None)

    def lose(self) -> None:
        """Drop the goal, because nobody answers any more."""
        self._resumes = self._resumes or self.on
        self.forget_goal()

    def relax(self) -> None:
        """Drop its goal and whatever would switch its torque on; the servos are not told."""
        self._overtaken += 1
        self._resumes = False
        self.forget_goal()

    def cut(self) -> None:
        """Switch the torque of all its servos off, at once and without waiting for an answer."""
        self.relax()
        release(self._port, self.servos)

    def switch_on(self) -> Steps[str]:
        """Hold the present position with torque on; return what went wrong, or nothing."""
        if self.on:
            return ""
        if self.stopped or self.faulted or self.resting or self.relaxed:
            return str(self.torque.value)
        if not self.complete:
            return "the servo does not answer"
        return (yield from self.pin())

    def pin(self, powered: bool = False) -> Steps[str]:
        """Make torque on and the present position the goal; return what went wrong, or nothing.

        Args:
            powered: Whether the torque of its servos is on already.
        """
        ticks: list[int] = []
        overtaken = self._overtaken
        try:
            for servo in self.servos:
                steps = pin(servo, self._range(servo), powered)
                ticks.append((yield from self._unless_overtaken(steps, overtaken)))
        except GeneratorExit:  # given up; the goal alone may have switched torque on
            with suppress(DynamixelError):
                self.cut()
            raise
        except (CommunicationError, ServoError) as cause:
            # The goal alone may have switched torque on.
            self.cut()
            with suppress(DynamixelError):
                yield from relaxing(self._port, self.servos)
            return str(cause)
        pairs = zip(self.servos, ticks, strict=True)  # limits may have been narrowed meanwhile
        self._set_goal(tuple([self._inside(servo, tick) for servo, tick in pairs]), 0.0, None)
        self.on = True
        self._resumes = False
        return ""

    def _unless_overtaken(self, steps: Steps[int], overtaken: int) -> Steps[int]:
        """Take steps as long as nobody relaxes the joint."""
        while True:
            try:
                yield next(steps)
            except StopIteration as end:
                ticks: int = end.value
                return ticks
            if self._overtaken != overtaken:
                raise ServoError("somebody has relaxed it meanwhile")

    def identify(self) -> Steps[None]:
        """Find its servos and relax them; raises as `Servo.identify` does."""
        for servo in self.servos:
            servo.ping(3)
            yield 0.0
            yield from servo.identify()

    def come_back(self, servo: Servo) -> Steps[str]:
        """Take a servo that answers again back; return what became of the torque.

        A servo that kept its torque while it was silent holds where it stands, if the joint was
        on; else it is relaxed.

        Raises:
            CommunicationError: It does not answer.
            ServoError: It is not what the configuration says, or cannot be used.
            ConfigurationError: Its own angle limits leave the joint no range.
        """
        others = self.on
        overtaken = self._overtaken
        keep = others or (self._resumes and not (self.relaxed or self.resting))
        identity = yield from servo.identify(keep_torque=keep)
        if self._overtaken != overtaken:
            release(self._port, (servo,))
            return self.torque.value
        if keep and identity.faulted:
            self.cut()
        elif keep and not self.complete:
            return "its other servo does not answer"
        elif keep and (identity.powered or others):
            problem = yield from self.pin(powered=identity.powered)
            if problem:
                return f"relaxed, because it does not hold: {problem}"
            return "it kept its torque and holds where it stands"
        elif keep and len(self.servos) > 1:
            self.cut()  # the other one may hold
        self._resumes = False
        return self.torque.value

    def recover(self, now: int) -> Steps[str]:
        """Clear the fault of its servos; return what went wrong, or nothing.

        Servos that restart are lost until the bus finds them again.

        Args:
            now: Monotonic time, ns.
        """
        if self.lost:
            return "the servo does not answer"
        self.cut()
        try:
            for servo in self.servos:
                if not servo.faulted or servo.lost:
                    continue
                yield from recover(servo)
                if servo.model.protocol == 2:
                    servo.lose(now)
        except (CommunicationError, ServoError) as cause:
            return str(cause)
        return ""

    def check(self, lowest: int, highest: int) -> None:
        """Refuse limits that cannot be set; raises as `reconfigure` does. Changes nothing."""
        self._reconfigured(lowest, highest, None)

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
        new = self._reconfigured(lowest, highest, max_speed)
        self.servos[0].calibrate(new)
        self.configuration = new
        self._limit_speed()
        if self.goal_ticks:
            pairs = zip(self.servos, self.goal_ticks, strict=True)
            ticks = tuple([self._inside(servo, each) for servo, each in pairs])
            self._set_goal(ticks, self.goal_speed, self.commanded_at)

    def _reconfigured(
        self, lowest: int | None, highest: int | None, max_speed: float | None
    ) -> JointConfiguration:
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
        lower, upper = self._common(first, last)
        if lower >= upper:
            raise ConfigurationError(
                f"{self.name}: its two servos allow no position in common, one no less than "
                f"{lower:.3f} rad, one no more than {upper:.3f} rad; correct min and max, or the "
                "servos' own angle limits"
            )
        return new


def _both(one: IntFlag, other: IntFlag) -> IntFlag:
    return one | other if type(one) is type(other) else one or other
