"""A joint as the bus keeps it: its servos, its limits, its torque, its goal."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntFlag

from head_tracking.dynamixel.bus_servo import BusServo
from head_tracking.dynamixel.command import Goal, Torque, check_finite, within_limits
from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import CommunicationError, GoalError, ServoError
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.servo_link import SLOWEST
from head_tracking.dynamixel.servo_state import ServoState

_REMEDIES = {
    Torque.OFF_ON_REQUEST: "the joint is relaxed on request; switch its torque on first "
    "(torque_enable true on {})",
    Torque.OFF_TO_COOL: "the joint's servo is too hot and rests; it takes commands again when it "
    "has cooled down",
    Torque.OFF_BY_FAULT: "the joint's servo has shut itself down; find out why, then call recover",
    Torque.OFF_STOPPED: "the joint is stopped; start it first ({}/start)",
}


@dataclass(slots=True)
class _WireGoal:
    """What is written each cycle: a tick for each servo and a speed.

    The speed is in rad/s; None stands for the joint's own, 0 for the slowest. `shares` are the
    bytes for each servo, made for the speed `encoded`.
    """

    ticks: tuple[int, ...]
    speed: float | None
    since: int
    shares: tuple[bytes, ...] = field(default=())
    encoded: float = -1.0


class BusJoint:
    """State of one joint. Only the thread that owns the bus changes it; any thread may look.

    Args:
        configuration: How the joint is wired.
        port: Where its servos are.

    Attributes:
        name: The joint's name.
        servos: Its servo, or its two.
        torque: Why it holds or does not hold its position.
        default_speed: Speed for goals that give none, rad/s.
        resumes: Whether it was on when its servo was lost, and may be so again.
    """

    def __init__(self, configuration: JointConfiguration, port: ServoPort) -> None:
        self.configuration = configuration
        self.name = configuration.joint_name
        self.servos = tuple(BusServo(mount, port) for mount in configuration.mounts)
        self.torque = Torque.OFF_UNTIL_COMMANDED
        self.default_speed = configuration.joint_speed
        self.resumes = False
        self._goal: _WireGoal | None = None

    @property
    def stopped(self) -> bool:
        """Whether it takes no part in the cycle, on request."""
        return self.torque is Torque.OFF_STOPPED

    @property
    def lost(self) -> bool:
        """Whether no servo of it answers."""
        return all(servo.lost for servo in self.servos)

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest position, rad, allowed by configuration and servos."""
        ends = [
            sorted(servo.mount.position(tick) for tick in servo.range) for servo in self.servos
        ]
        return (max(lower for lower, _ in ends), min(upper for _, upper in ends))

    @property
    def drives(self) -> bool:
        """Whether goals are written to its servos."""
        return self._goal is not None and self.torque is Torque.ON and not self.lost

    @property
    def goal_position(self) -> float | None:
        """The goal that is being written, rad."""
        return None if self._goal is None else self.servos[0].mount.position(self._goal.ticks[0])

    @property
    def commanded_at(self) -> int | None:
        """Monotonic time, ns, of the goal; None without one, or for one that is held."""
        return None if self._goal is None or self._goal.since == 0 else self._goal.since

    def admit(self, goal: Goal, clamp: bool) -> float:
        """Return the position to go to, rad, or refuse the goal. Changes nothing.

        Raises:
            GoalError: The goal is no number, outside the limits, or the joint takes no commands.
        """
        check_finite(self.name, goal)
        if self.torque.waits:
            remedy = _REMEDIES[self.torque].format(self.configuration.controller)
            raise GoalError(f"{self.name}: command refused, {remedy}")
        lower, upper = self.limits
        tolerance = self.configuration.resolution
        return within_limits(self.name, goal.position, lower, upper, tolerance, clamp)

    # Owner's thread

    def lose(self) -> None:
        """Drop the goal and what the servos said, because they do not answer any more."""
        self.resumes = self.torque is Torque.ON
        self.forget_goal()
        for servo in self.servos:
            servo.feedback = None

    def come_back(self, servo: BusServo) -> str:
        """Take a servo that answers again back; return what became of the torque.

        A servo that kept its torque while it was silent holds where it stands, if the joint was
        on; else it is relaxed.

        Raises:
            CommunicationError: It does not answer.
            ServoError: It is not what the configuration says, or cannot be used.
            ConfigurationError: Its own angle limits leave the joint no range.
            PortLostError: The port has gone.
        """
        others = self.torque is Torque.ON
        keep = others or (self.resumes and self.torque is Torque.OFF_UNTIL_COMMANDED)
        identity = servo.identify(keep_torque=keep)
        if keep and (identity.powered or others):
            problem = self.pin()
            if problem:
                return f"relaxed, because it does not hold: {problem}"
            return "it kept its torque and holds where it stands"
        self.resumes = False
        return self.torque.value

    def switch_on(self) -> str:
        """Hold the present position with torque on; return what went wrong, or nothing.

        Raises:
            PortLostError: The port has gone.
        """
        if self.torque is Torque.ON:
            return ""
        if self.torque in (Torque.OFF_BY_FAULT, Torque.OFF_STOPPED, Torque.OFF_TO_COOL):
            return self.torque.value
        if self.lost:
            return "the servo does not answer"
        return self.pin()

    def pin(self) -> str:
        """Make torque on and the present position the goal; return what went wrong, or nothing.

        Raises:
            PortLostError: The port has gone.
        """
        ticks: list[int] = []
        for servo in self.servos:
            if servo.lost:
                ticks.append(servo.range[0])  # never written while it is lost
                continue
            try:
                ticks.append(servo.pin())
            except (CommunicationError, ServoError) as cause:
                # The goal alone may have switched torque on.
                self.forget_goal()
                for each in self.servos:
                    with suppress(CommunicationError, ServoError):
                        each.link.set_torque(False)
                return str(cause)
        self._goal = _WireGoal(tuple(ticks), 0.0, 0)
        self.torque = Torque.ON
        self.resumes = False
        return ""

    def switch_off(self, state: Torque) -> str:
        """Relax the servos, drop the goal; return what went wrong, or nothing.

        Args:
            state: The torque state from now on.

        Raises:
            PortLostError: The port has gone.
        """
        self.torque = state
        self.resumes = False
        self._goal = None
        problems: list[str] = []
        for servo in self.servos:
            if servo.lost:
                servo.link.release()
                problems.append("the servo does not answer")
                continue
            try:
                servo.link.set_torque(False)
            except (CommunicationError, ServoError) as cause:
                problems.append(str(cause))
        return "; ".join(problems)

    def aim(self, goal: Goal, now: int) -> None:
        """Make this the goal that is written from now on.

        Args:
            goal: Where to go.
            now: Monotonic time, ns.
        """
        ticks = tuple(servo.inside(servo.mount.ticks(goal.position)) for servo in self.servos)
        self._goal = _WireGoal(ticks, goal.speed, now)

    def stop(self, retries: int) -> None:
        """Make the present position the goal, at the speed of the previous one.

        A servo that does not answer gets its last known position.

        Raises:
            PortLostError: The port has gone.
        """
        if self._goal is None:
            return
        ticks = list(self._goal.ticks)
        for index, servo in enumerate(self.servos):
            present = None if servo.feedback is None else servo.feedback.ticks
            with suppress(CommunicationError):
                if servo.failed_cycles == 0 and not servo.lost:
                    present = servo.link.read_position(retries)
            if present is not None:
                ticks[index] = servo.inside(servo.mount.fold(present))
        self._goal = _WireGoal(tuple(ticks), self._goal.speed, 0)

    def forget_goal(self) -> None:
        """Drop the goal, so that nothing is written any more; torque is not on without one."""
        self._goal = None
        if self.torque is Torque.ON:
            self.torque = Torque.OFF_UNTIL_COMMANDED

    def shares(self) -> tuple[bytes, ...]:
        """Return the bytes of goal position and speed for each servo; only while `drives`."""
        goal = self._goal
        assert goal is not None
        speed = self.default_speed if goal.speed is None else goal.speed
        if goal.encoded != speed:
            limit = self.configuration.speed_limit
            goal.shares = tuple(
                servo.mount.model.encode_goal(
                    ticks, servo.mount.speed_ticks(speed, limit) if speed > 0.0 else SLOWEST
                )
                for servo, ticks in zip(self.servos, goal.ticks, strict=True)
            )
            goal.encoded = speed
        return goal.shares

    def state(self, answered: list[BusServo]) -> ServoState:
        """Return the joint's state from those of its servos that answered in this cycle."""
        first = answered[0]
        feedback, mount = first.feedback, first.mount
        assert feedback is not None
        goal = self._goal
        load = mount.load(feedback.load)
        voltage, temperature, errors = feedback.voltage, feedback.temperature, first.errors
        for other in answered[1:]:
            assert other.feedback is not None
            load = (load + other.mount.load(other.feedback.load)) / 2.0
            voltage = min(voltage, other.feedback.voltage)
            temperature = max(temperature, other.feedback.temperature)
            errors = _both(errors, other.errors)
        return ServoState(
            self.name,
            first.id,
            first.stamp,
            mount.position(mount.fold(feedback.ticks)),
            mount.velocity(feedback.speed),
            load,
            voltage * 0.1,
            float(temperature),
            errors,
            self.torque is Torque.ON,
            None if goal is None else self.servos[0].mount.position(goal.ticks[0]),
        )


def _both(one: IntFlag, other: IntFlag) -> IntFlag:
    return one | other if type(one) is type(other) else one or other
