"""The servo bus: all servos of one port, read and written in one cycle."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress

from head_tracking.dynamixel.bus_joint import BusJoint
from head_tracking.dynamixel.command import CommandResult, Goal, Torque, check_speed
from head_tracking.dynamixel.configuration import JointConfiguration, check_configuration
from head_tracking.dynamixel.exceptions import (
    DynamixelError,
    GoalError,
    NotConnectedError,
    ServoNotFoundError,
    TorqueError,
)
from head_tracking.dynamixel.goal_inbox import GoalInbox
from head_tracking.dynamixel.identification import ServoIdentity, answering, summary
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.servo_link import ServoLink
from head_tracking.dynamixel.servo_state import (
    BusReading,
    BusStatistics,
    EventKind,
    ServoState,
)
from head_tracking.dynamixel.supervision import Supervision


class ServoBus:
    """Reads and drives the servos of one port.

    One thread owns the bus: it calls `connect`, `step`, `set_torque`, `hold` and `close`
    (`BusThread` is that thread). Any thread may call `command`, `set_speed` and what only looks:
    `statistics`, `limits`, `torque`, `speed`, `servos`, `summary`.

    Servos start relaxed. The first command to a joint switches its torque on; after
    `set_torque(..., False)` commands are refused until `set_torque(..., True)`. Goals outside the
    limits never reach the wire, nor does a moving speed of 0, nor a goal for a relaxed servo.

    Args:
        port: Where the servos are.
        joints: The joints to drive.
        clock: Time for the stamps of measurements, ns.
        monotonic: Time that never jumps, ns; decides when a lost servo is asked again.
        retries: How often a failed read is repeated within the same cycle.
        lost_after: Failed cycles in a row after which a servo counts as lost.
        poll_interval: Time between two questions to a lost servo, s.

    Raises:
        ConfigurationError: The joints contradict each other, or a number makes no sense.
    """

    def __init__(
        self,
        port: ServoPort,
        joints: Iterable[JointConfiguration],
        clock: Callable[[], int] = time.time_ns,
        *,
        monotonic: Callable[[], int] = time.monotonic_ns,
        retries: int = 1,
        lost_after: int = 5,
        poll_interval: float = 0.5,
    ) -> None:
        self._port = port
        self._clock = clock
        self._retries = retries
        self._supervision = Supervision(
            clock, monotonic, retries, lost_after, round(poll_interval * 1e9)
        )
        self._joints = {
            joint.joint_name: BusJoint(joint, ServoLink(port, joint.id, joint.model))
            for joint in check_configuration(joints)
        }
        self._inbox = GoalInbox()
        self._connected = False
        self._cycles = 0

    # Owner's thread

    def connect(self) -> str:
        """Open the port, find all servos, relax them, and return a line that says what is there.

        Returns:
            A summary such as "2 AX-12 servos: ids 1, 2".

        Raises:
            PortError: The port cannot be opened.
            ServoNotFoundError: A configured id does not answer.
            ServoError: A servo is another model, in wheel mode, silent, or does not relax.
            ConfigurationError: A servo's own angle limits leave a joint no range.
            CommunicationError: A servo answers pings, but then fails.
        """
        joints = tuple(self._joints.values())
        self._port.open()
        try:
            asked = [joint.link.id for joint in joints]
            found = answering([joint.link for joint in joints])
            if len(found) < len(asked):
                raise ServoNotFoundError(asked, found, self._port.name, self._port.baud_rate)
            for joint in joints:
                joint.identify()
        except BaseException:
            self._port.close()
            raise
        self._inbox.take()
        self._connected = True
        return self.summary

    def step(self) -> BusReading:
        """Run one cycle: read every servo, then write all goals in one packet.

        Returns:
            What was read in this cycle; joints that did not answer are absent.

        Raises:
            PortLostError: The port has gone.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        self._cycles += 1
        stamp = self._clock()
        states: dict[str, ServoState] = {}
        failed: list[str] = []
        for joint in self._joints.values():
            if joint.lost:
                continue
            state = self._supervision.read(joint)
            if state is None:
                failed.append(joint.name)
            else:
                states[joint.name] = state
        self._supervision.poll_one_lost(self._joints.values())
        self._take_goals()
        self._write_goals()
        lost = tuple(joint.name for joint in self._joints.values() if joint.lost)
        events = self._supervision.take_events()
        return BusReading(self._cycles, stamp, states, tuple(failed), lost, events)

    def set_torque(self, joints: Iterable[str] | None, on: bool) -> None:
        """Switch the torque of some joints, or of all (None).

        Torque on holds the present position. Torque off drops the goal; commands are refused until
        torque is switched on again.

        Raises:
            GoalError: A joint is unknown; nothing was switched.
            TorqueError: Some joints did not confirm; the others were switched.
            PortLostError: The port has gone.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        chosen = (
            list(self._joints.values())
            if joints is None
            else [self._joint(name) for name in dict.fromkeys(joints)]
        )
        problems: dict[str, object] = {}
        for joint in chosen:
            if on:
                problem, kind = joint.switch_on(), EventKind.TORQUE_ON
            else:
                self._inbox.drop(joint.name)
                problem, kind = joint.switch_off(Torque.OFF_ON_REQUEST), EventKind.TORQUE_OFF
            if problem:
                problems[joint.name] = problem
            else:
                self._supervision.report(kind, joint, joint.torque.value)
        if problems:
            raise TorqueError(on, problems)

    def hold(self) -> None:
        """Stop now: make the present position the goal of every joint with torque on.

        Raises:
            PortLostError: The port has gone.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        self._inbox.take()
        for joint in self._joints.values():
            joint.stop(self._retries)
        self._write_goals()

    def close(self) -> tuple[str, ...]:
        """Hold, relax every servo, close the port. Never raises for what happens on the wire.

        Returns:
            Joints that did not confirm that they are relaxed.
        """
        unconfirmed: list[str] = []
        try:
            if self._connected:
                with suppress(DynamixelError):
                    self.hold()
                for joint in self._joints.values():
                    if not self._relaxed_for_good(joint):
                        unconfirmed.append(joint.name)
        finally:
            self._connected = False
            self._port.close()
        return tuple(unconfirmed)

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
            GoalError: A joint is unknown or relaxed on request, a position is not finite or
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
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The configured joints."""
        return tuple(joint.configuration for joint in self._joints.values())

    @property
    def servos(self) -> tuple[ServoIdentity, ...]:
        """What was found on the bus; empty before `connect`."""
        found = (joint.identity for joint in self._joints.values())
        return tuple(identity for identity in found if identity is not None)

    @property
    def summary(self) -> str:
        """A line that says what was found, such as "2 AX-12 servos: ids 1, 2"."""
        return summary(self.servos)

    def statistics(self) -> BusStatistics:
        """Return the counters."""
        servos = tuple(joint.statistics() for joint in self._joints.values())
        return BusStatistics(self._cycles, self._inbox.refused, self._inbox.clamped, servos)

    # Steps of a cycle

    def _take_goals(self) -> None:
        for name, goal in self._inbox.take().items():
            joint = self._joints[name]
            if joint.lost or joint.torque is Torque.OFF_ON_REQUEST:
                continue  # since the command was accepted
            if joint.torque is not Torque.ON:
                problem = joint.switch_on()
                if problem:
                    text = f"goal dropped: {problem}"
                    self._supervision.report(EventKind.TORQUE_FAILED, joint, text)
                    continue
                self._supervision.report(EventKind.TORQUE_ON, joint, joint.torque.value)
            joint.aim(goal)

    def _write_goals(self) -> None:
        packets: dict[tuple[int, int], dict[int, bytes]] = {}
        for joint in self._joints.values():
            if joint.drives:
                block = joint.configuration.model.goal
                shares = packets.setdefault((block.address, block.length), {})
                shares[joint.link.id] = joint.wire_goal()
        for (address, _), shares in packets.items():
            self._port.sync_write(address, shares)

    def _relaxed_for_good(self, joint: BusJoint) -> bool:
        relaxed = Torque.OFF_UNTIL_COMMANDED if joint.torque is Torque.ON else joint.torque
        try:
            return not joint.switch_off(relaxed)
        except DynamixelError:
            return False

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
