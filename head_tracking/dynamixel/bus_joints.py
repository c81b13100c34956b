"""The joints of a bus, and what may be asked of them besides the cycle."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.bus_joint import BusJoint
from head_tracking.dynamixel.command import CommandResult, Goal, Torque, check_speed
from head_tracking.dynamixel.configuration import JointConfiguration, check_configuration
from head_tracking.dynamixel.eeprom import EepromSettings, write_eeprom
from head_tracking.dynamixel.exceptions import (
    DynamixelError,
    GoalError,
    NotConnectedError,
    PortLostError,
    ServoError,
    TorqueError,
)
from head_tracking.dynamixel.goal_inbox import GoalInbox
from head_tracking.dynamixel.identification import ServoIdentity, summary
from head_tracking.dynamixel.journal import Journal
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.servo_state import EventKind
from head_tracking.dynamixel.settings import BusSettings


class BusJoints:
    """Takes commands and requests for the joints of a bus, by name.

    Args:
        port: Where their servos are.
        joints: How they are wired.
        monotonic: Time that never jumps, ns.
        settings: How to deal with silence, faults and heat.

    Raises:
        ConfigurationError: The joints contradict each other.
    """

    def __init__(
        self,
        port: ServoPort,
        joints: Iterable[JointConfiguration],
        monotonic: Callable[[], int],
        settings: BusSettings,
    ) -> None:
        self._port = port
        self._monotonic = monotonic
        self._joints = {
            joint.joint_name: BusJoint(joint, port, settings.watchdog)
            for joint in check_configuration(joints)
        }
        self._journal = Journal()
        self._inbox = GoalInbox()
        self._connected = False

    # Any thread

    def command(self, goals: Mapping[str, Goal], *, clamp: bool = False) -> CommandResult:
        """Set the goals of some joints; the newest goal of a joint wins.

        The goals are written in the owner's next cycle. Speeds above a joint's `speed_limit` are
        reduced to it.

        Args:
            goals: Goal by joint name.
            clamp: Move positions outside the limits to the limit instead of refusing them. One
                tick of excess always counts as being on the limit.

        Raises:
            GoalError: A joint is unknown or takes no commands now, a position is not finite or
                outside the limits, a speed is not finite or not above 0, or no joint of the
                command answers. Nothing has changed.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        try:
            joints = {name: self._joint(name) for name in goals}
            return self._inbox.put(joints, goals, clamp)
        except GoalError:
            self._inbox.count_refusal()
            raise

    def set_speed(self, joint: str, speed: float) -> None:
        """Set the speed, rad/s, for commands that give none, also for one under way.

        Raises:
            GoalError: The joint is unknown, or the speed not finite or not above 0.
        """
        check_speed(joint, speed)
        self._joint(joint).default_speed = speed

    def speed(self, joint: str) -> float:
        """Return the speed for commands that give none, rad/s; raises GoalError if unknown."""
        return self._joint(joint).default_speed

    def torque(self, joint: str) -> Torque:
        """Return the torque of a joint; raises GoalError if it is unknown."""
        return self._joint(joint).torque

    def limits(self, joint: str) -> tuple[float, float]:
        """Return lowest and highest position, rad, that configuration and servo allow.

        Raises:
            GoalError: The joint is unknown.
        """
        return self._joint(joint).limits

    @property
    def port_name(self) -> str:
        """Device that the servos are on."""
        return self._port.name

    @property
    def adapter(self) -> Adapter:
        """What is known about the device since it was opened."""
        return self._port.adapter

    @property
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The configured joints."""
        return tuple(joint.configuration for joint in self._joints.values())

    @property
    def servos(self) -> tuple[ServoIdentity, ...]:
        """What was found on the bus; empty before `connect`."""
        found = (servo.identity for joint in self._joints.values() for servo in joint.servos)
        return tuple(identity for identity in found if identity is not None)

    @property
    def summary(self) -> str:
        """A line that says what was found, such as "2 AX-12 servos: ids 1, 2"."""
        return summary(self.servos)

    # Owner's thread

    def set_torque(self, joints: Iterable[str] | None, on: bool) -> None:
        """Switch the torque of some joints, or of all (None).

        Torque on holds the present position. Torque off drops the goal; commands are refused until
        torque is switched on again.

        Raises:
            GoalError: A joint is unknown; nothing was switched.
            TorqueError: Some joints did not confirm; the others were switched.
            NotConnectedError: `connect` has not been called.
        """

        def switch(joint: BusJoint) -> str:
            if on:
                return joint.switch_on()
            self._inbox.drop(joint.name)
            if joint.stopped:
                return ""
            return joint.switch_off(Torque.OFF_ON_REQUEST)

        kind = EventKind.TORQUE_ON if on else EventKind.TORQUE_OFF
        problems = self._each(joints, switch, kind)
        if problems:
            raise TorqueError(on, problems)

    def recover(self, joints: Iterable[str] | None = None) -> tuple[str, ...]:
        """Clear the faults of some joints, or of all (None), and leave them relaxed.

        Protocol 1.0 servos are ready at once; others restart and are found again some cycles
        later, which `torque` tells.

        Returns:
            The joints that had a fault.

        Raises:
            GoalError: A joint is unknown; nothing was done.
            ServoError: A servo does not recover.
            NotConnectedError: `connect` has not been called.
        """
        faulted = [
            joint.name for joint in self._chosen(joints) if joint.torque is Torque.OFF_BY_FAULT
        ]
        problems = self._each(
            faulted, lambda joint: joint.recover(self._monotonic()), EventKind.RECOVERED
        )
        if problems:
            raise ServoError(_told(problems))
        return tuple(faulted)

    def stop(self, joints: Iterable[str] | None) -> None:
        """Relax some joints, or all (None), and take them out of the cycle until `start`.

        Raises:
            GoalError: A joint is unknown; nothing was done.
            TorqueError: Some did not confirm that they are relaxed; they are stopped all the same.
            NotConnectedError: `connect` has not been called.
        """

        def stop(joint: BusJoint) -> str:
            self._inbox.drop(joint.name)
            return "" if joint.stopped else joint.switch_off(Torque.OFF_STOPPED)

        problems = self._each(joints, stop, EventKind.STOPPED)
        if problems:
            raise TorqueError(False, problems)

    def start(self, joints: Iterable[str] | None) -> None:
        """Take stopped joints, or all (None), back into the cycle, relaxed; find them anew.

        Raises:
            GoalError: A joint is unknown; nothing was done.
            ServoError: A servo is missing, or cannot be used; it is looked for from now on.
            NotConnectedError: `connect` has not been called.
        """

        def start(joint: BusJoint) -> str:
            if not joint.stopped:
                return ""
            joint.torque = Torque.OFF_UNTIL_COMMANDED
            try:
                joint.identify()
            except DynamixelError as cause:
                for servo in joint.servos:
                    servo.lose(0)
                return str(cause)
            return ""

        problems = self._each(joints, start, EventKind.STARTED)
        if problems:
            raise ServoError(_told(problems))

    def set_limits(
        self,
        joint: str,
        *,
        lowest: int | None = None,
        highest: int | None = None,
        max_speed: float | None = None,
    ) -> None:
        """Change the limits of a joint; a goal outside moves inside. None leaves one as it is.

        Args:
            joint: The joint.
            lowest: Its `min`, in ticks.
            highest: Its `max`, in ticks.
            max_speed: Highest speed, rad/s; 0 for the model's own.

        Raises:
            GoalError: The joint is unknown.
            ConfigurationError: Its servo cannot do that; nothing has changed.
        """
        self._joint(joint).reconfigure(lowest, highest, max_speed)

    def write_eeprom(
        self,
        joint: str,
        settings: EepromSettings,
        pause: Callable[[float], object] = time.sleep,
    ) -> dict[int, dict[str, tuple[int, int]]]:
        """Write settings into the memory of a relaxed joint's servos; takes some 0.1 s for each.

        Args:
            joint: The joint.
            settings: What they shall keep.
            pause: Waits so many seconds.

        Returns:
            Old and new values of what was changed, by servo id and register name.

        Raises:
            GoalError: The joint is unknown.
            ConfigurationError: A model has no such setting; nothing was written.
            ServoError: A servo has its torque on, or does not keep a value.
            CommunicationError: A servo does not answer.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        servos = self._joint(joint).servos
        wanted = {s.id: settings.registers(s.mount.model, s.mount.tick_range) for s in servos}
        changed = {s.id: write_eeprom(s.link, wanted[s.id], pause) for s in servos}
        for servo in servos:
            if not self._joint(joint).stopped and not servo.lost:
                servo.identify()
        return changed

    def _each(
        self,
        joints: Iterable[str] | None,
        action: Callable[[BusJoint], str],
        kind: EventKind,
    ) -> dict[str, object]:
        """Do something to some joints, or to all; return what went wrong, by joint."""
        self._require_connection()
        problems: dict[str, object] = {}
        for joint in self._chosen(joints):
            try:
                problem = action(joint)
            except (PortLostError, NotConnectedError) as cause:
                problem = str(cause)
            if problem:
                problems[joint.name] = problem
            else:
                self._note(kind, joint, joint.torque.value)
        return problems

    def _chosen(self, joints: Iterable[str] | None) -> list[BusJoint]:
        if joints is None:
            return list(self._joints.values())
        return [self._joint(name) for name in dict.fromkeys(joints)]

    def _note(self, kind: EventKind, joint: BusJoint, text: str) -> None:
        self._journal.note(kind, joint.name, joint.servos[0].id, text)

    def _require_connection(self) -> None:
        if not self._connected:
            raise NotConnectedError(f"the bus on {self._port.name} is not connected")

    def _joint(self, name: str) -> BusJoint:
        try:
            return self._joints[name]
        except KeyError:
            raise GoalError(
                f"no joint {name!r} on this bus; it has {', '.join(self._joints)}"
            ) from None


def _told(problems: Mapping[str, object]) -> str:
    return "; ".join(f"{joint}: {problem}" for joint, problem in problems.items())
