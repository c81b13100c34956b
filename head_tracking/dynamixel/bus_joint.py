"""A joint as the bus keeps it: its servos, its limits, its torque, its goal."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from enum import IntFlag
from functools import reduce

from head_tracking.dynamixel.bus_servo import BusServo
from head_tracking.dynamixel.command import Goal, Torque, check_finite, within_limits
from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import CommunicationError, GoalError, ServoError
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.servo_state import ServoState
from head_tracking.dynamixel.wire_goal import WireGoal

_REMEDIES = {
    Torque.OFF_ON_REQUEST: "the joint is relaxed on request; switch its torque on first "
    "(torque_enable true on {})",
    Torque.OFF_TO_COOL: "the joint's servo is too hot and rests; it takes commands again when it "
    "has cooled down",
    Torque.OFF_BY_FAULT: "the joint's servo has shut itself down; find out why, then call recover",
    Torque.OFF_STOPPED: "the joint is stopped; start it first ({}/start)",
}


class BusJoint:
    """State of one joint. Only the thread that owns the bus changes it; any thread may look.

    Args:
        configuration: How the joint is wired.
        port: Where its servos are.
        watchdog: Time without any packet after which its servos shall stop, s; 0: never.

    Attributes:
        name: The joint's name.
        configuration: How the joint is wired.
        servos: Its servo, or its two.
        torque: Why it holds or does not hold its position.
        default_speed: Speed for goals that give none, rad/s.
    """

    def __init__(
        self, configuration: JointConfiguration, port: ServoPort, watchdog: float = 0.0
    ) -> None:
        self.configuration = configuration
        self.name = configuration.joint_name
        self.servos = tuple(BusServo(mount, port, watchdog) for mount in configuration.mounts)
        self.torque = Torque.OFF_UNTIL_COMMANDED
        self.default_speed = configuration.joint_speed
        self._resumes = False  # it was on when its servo was lost, and may be so again
        self._recovers = False  # its servo restarts because somebody wants to clear its fault
        self._goal: WireGoal | None = None

    @property
    def stopped(self) -> bool:
        """Whether it takes no part in the cycle, on request."""
        return self.torque is Torque.OFF_STOPPED

    @property
    def lost(self) -> bool:
        """Whether no servo of it answers."""
        return self.servos[0].lost and all(servo.lost for servo in self.servos)

    @property
    def watched(self) -> bool:
        """Whether a servo of it stops by itself when it hears nothing."""
        return any(servo.watched for servo in self.servos)

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest position, rad, allowed by configuration and servos."""
        if len(self.servos) == 1:
            return self.servos[0].limits
        ends = [servo.limits for servo in self.servos]
        return (max(lower for lower, _ in ends), min(upper for _, upper in ends))

    @property
    def drives(self) -> bool:
        """Whether goals are written to its servos."""
        return self._goal is not None and self.torque is Torque.ON

    @property
    def commanded_at(self) -> int | None:
        """Monotonic time, ns, of the goal; None without one, or for one that is held."""
        return None if self._goal is None else self._goal.since

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

    # Owner's thread. Everything that talks to servos raises PortLostError when the port has gone.

    def identify(self) -> None:
        """Find its servos and relax them; raises as `BusServo.identify` does."""
        for servo in self.servos:
            servo.link.ping(retries=2)
            servo.identify()

    def lose(self) -> None:
        """Drop the goal, because nobody answers any more."""
        self._resumes = self._resumes or self.torque is Torque.ON
        self.forget_goal()

    def come_back(self, servo: BusServo) -> str:
        """Take a servo that answers again back; return what became of the torque.

        A servo that kept its torque while it was silent holds where it stands, if the joint was
        on; else it is relaxed.

        Raises:
            CommunicationError: It does not answer.
            ServoError: It is not what the configuration says, or cannot be used.
            ConfigurationError: Its own angle limits leave the joint no range.
        """
        others = self.torque is Torque.ON
        keep = others or (self._resumes and self.torque is Torque.OFF_UNTIL_COMMANDED)
        identity = servo.identify(keep_torque=keep)
        servo.faulted = False
        if self._recovers and not self.lost:
            self._recovers = False
            self.torque = Torque.OFF_UNTIL_COMMANDED
        if keep and (identity.powered or others):
            problem = self.pin()
            if problem:
                return f"relaxed, because it does not hold: {problem}"
            return "it kept its torque and holds where it stands"
        self._resumes = False
        return self.torque.value

    def switch_on(self) -> str:
        """Hold the present position with torque on; return what went wrong, or nothing."""
        if self.torque is Torque.ON:
            return ""
        if self.torque in (Torque.OFF_BY_FAULT, Torque.OFF_STOPPED, Torque.OFF_TO_COOL):
            return str(self.torque.value)
        if self.lost:
            return "the servo does not answer"
        return self.pin()

    def pin(self) -> str:
        """Make torque on and the present position the goal; return what went wrong, or nothing."""
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
        self._goal = WireGoal(tuple(ticks), 0.0, None)
        self.torque = Torque.ON
        self._resumes = False
        return ""

    def switch_off(self, state: Torque) -> str:
        """Relax the servos, drop the goal; return what went wrong, or nothing.

        Args:
            state: The torque state from now on.
        """
        self.torque = state
        self._resumes = self._recovers = False
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

    def recover(self, now: int) -> str:
        """Clear the fault of its servos; return what went wrong, or nothing.

        Protocol 1.0 servos get their torque limit back. Others restart, which takes a while; the
        bus finds them again by itself.

        Args:
            now: Monotonic time, ns.
        """
        if self.lost:
            return "the servo does not answer"
        self.switch_off(Torque.OFF_BY_FAULT)
        try:
            for servo in self.servos:
                if servo.mount.model.protocol == 1:
                    servo.link.restore_torque_limit()
                    servo.faulted = False
                else:
                    servo.link.reboot()
                    servo.lose(now)
                    self._recovers = True
        except (CommunicationError, ServoError) as cause:
            return str(cause)
        if not self._recovers:
            self.torque = Torque.OFF_UNTIL_COMMANDED
        return ""

    def reconfigure(self, lowest: int | None, highest: int | None, max_speed: float | None) -> None:
        """Take over other limits; None leaves one as it is. A goal outside moves inside.

        Args:
            lowest: `min` of the first servo, ticks.
            highest: `max` of the first servo, ticks.
            max_speed: Highest speed, rad/s; 0 for the model's own.

        Raises:
            ConfigurationError: The servo cannot do that; nothing has changed.
        """
        old = self.configuration
        new = replace(
            old,
            min=old.min if lowest is None else lowest,
            max=old.max if highest is None else highest,
            joint_speed=min(old.joint_speed, max_speed or old.joint_speed),
            max_speed=old.max_speed if max_speed is None else max_speed or None,
        )
        self.servos[0].remount(new.mount)
        self.configuration = new
        self.default_speed = min(self.default_speed, new.speed_limit)
        if self._goal is not None:
            first, *others = self._goal.ticks
            ticks = (self.servos[0].inside(first), *others)
            self._goal = WireGoal(ticks, self._goal.speed, self._goal.since)

    def aim(self, goal: Goal, now: int) -> None:
        """Make this the goal that is written from now on; `now` is monotonic, ns."""
        ticks = tuple(servo.inside(servo.mount.ticks(goal.position)) for servo in self.servos)
        self._goal = WireGoal(ticks, goal.speed, now)

    def hold(self, retries: int) -> None:
        """Make the present position the goal, at the speed of the previous one.

        A servo that does not answer gets its last known position.
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
        self._goal = WireGoal(tuple(ticks), self._goal.speed, None)

    def keep_goal(self) -> None:
        """Hold the goal from now on, because it has been reached."""
        if self._goal is not None:
            self._goal.since = None

    def forget_goal(self) -> None:
        """Drop the goal, so that nothing is written any more; torque is not on without one."""
        self._goal = None
        if self.torque is Torque.ON:
            self.torque = Torque.OFF_UNTIL_COMMANDED

    def shares(self) -> tuple[bytes, ...]:
        """Return the bytes of goal position and speed for each servo; only while `drives`."""
        assert self._goal is not None
        return self._goal.shares(
            [servo.mount for servo in self.servos],
            self.default_speed,
            self.configuration.speed_limit,
        )

    def state(self, answered: list[BusServo]) -> ServoState:
        """Return the joint's state from those of its servos that answered in this cycle."""
        first = answered[0]
        feedback, mount = first.feedback, first.mount
        assert feedback is not None
        goal = self._goal
        load = mount.load(feedback.load)
        voltage, temperature, errors = feedback.voltage, feedback.temperature, first.errors
        if len(answered) > 1:
            said = [servo.feedback for servo in answered if servo.feedback is not None]
            loads = [servo.mount.load(servo.feedback.load) for servo in answered if servo.feedback]
            load = sum(loads) / len(loads)
            voltage = min(each.voltage for each in said)
            temperature = max(each.temperature for each in said)
            errors = reduce(_both, (servo.errors for servo in answered))
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
