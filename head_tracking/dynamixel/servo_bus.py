"""The servo bus: all servos of one port, read and written in one cycle."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress

from head_tracking.dynamixel.bus_joint import BusJoint
from head_tracking.dynamixel.bus_joints import BusJoints
from head_tracking.dynamixel.bus_servo import BusServo
from head_tracking.dynamixel.command import Torque
from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import (
    DynamixelError,
    PortError,
    PortLostError,
    ServoNotFoundError,
)
from head_tracking.dynamixel.identification import answering
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.protection import Protection
from head_tracking.dynamixel.servo_state import BusReading, BusStatistics, EventKind, ServoState
from head_tracking.dynamixel.settings import BusSettings
from head_tracking.dynamixel.supervision import Supervision


class ServoBus(BusJoints):
    """Reads and drives the servos of one port.

    One thread owns the bus: it calls `connect`, `step`, everything that talks to servos, and
    `close` (`BusThread` is that thread). Any thread may call `command`, `set_speed` and what only
    looks: `statistics`, `limits`, `torque`, `speed`, `joints`, `servos`, `summary`.

    Servos start relaxed. The first command to a joint switches its torque on; after
    `set_torque(..., False)` commands are refused until `set_torque(..., True)`. Goals outside the
    limits never reach the wire, nor does a moving speed of 0, nor a goal for a relaxed servo.

    Servos that fall silent, and the adapter, may go and come back at any time: `step` goes on
    with what is there and looks for the rest.

    Args:
        port: Where the servos are.
        joints: The joints to drive.
        clock: Time for the stamps of measurements, ns.
        monotonic: Time that never jumps, ns.
        settings: How to deal with silence, faults and heat.

    Raises:
        ConfigurationError: The joints contradict each other.
    """

    def __init__(
        self,
        port: ServoPort,
        joints: Iterable[JointConfiguration],
        clock: Callable[[], int] = time.time_ns,
        *,
        monotonic: Callable[[], int] = time.monotonic_ns,
        settings: BusSettings | None = None,
    ) -> None:
        self._settings = settings or BusSettings()
        super().__init__(port, joints, monotonic, self._settings)
        self._clock = clock
        all_joints = tuple(self._joints.values())
        self._supervision = Supervision(
            port, all_joints, self._journal, clock, monotonic, self._settings
        )
        self._protection = Protection(all_joints, self._journal, monotonic, self._settings)
        self._port_losses = 0
        self._look_again_at: int | None = None  # the port has gone; ns
        self._cycles = 0

    # Owner's thread

    def connect(self, *, allow_missing: bool = False) -> str:
        """Open the port, find all servos, relax them, and return a line that says what is there.

        Args:
            allow_missing: Go on without the servos that do not answer, and look for them.

        Returns:
            A summary such as "2 AX-12 servos: ids 1, 2".

        Raises:
            PortError: The port cannot be opened.
            ServoNotFoundError: A configured id does not answer.
            ServoError: A servo is another model, in wheel mode, silent, or does not relax.
            ConfigurationError: A servo's own angle limits leave a joint no range.
            CommunicationError: A servo answers pings, but then fails.
        """
        servos = self._servos()
        self._port.open()
        try:
            found = answering([servo.link for servo in servos])
            if len(found) < len(servos) and not allow_missing:
                asked = [servo.id for servo in servos]
                raise ServoNotFoundError(asked, found, self._port.name, self._port.baud_rate)
            for servo in servos:
                if servo.id in found:
                    servo.identify()
                else:
                    servo.lose(0)
        except BaseException:
            self._port.close()
            raise
        self._inbox.take()
        self._look_again_at = None
        self._connected = True
        return self.summary

    def step(self) -> BusReading:
        """Run one cycle: read every servo and write all goals, in one packet for each protocol.

        Returns:
            What was read in this cycle; joints that did not answer are absent.

        Raises:
            NotConnectedError: `connect` has not been called.
            PortLostError: The port has gone and cannot come back under its name.
        """
        self._require_connection()
        self._cycles += 1
        stamp = self._clock()
        states: Mapping[str, ServoState] = {}
        failed: tuple[str, ...] = ()
        try:
            if self._port_is_there():
                self._protection.before_cycle()
                self._take_goals()
                states, failed = self._supervision.read(self._prepare_goals)
                self._port.flush()
                self._protection.after_cycle(states)
                self._supervision.poll_one_lost()
        except PortLostError as cause:
            if not self._port.comes_back:
                raise
            self._lose_port(str(cause))
        lost = tuple([name for name, joint in self._joints.items() if joint.lost])
        return BusReading(self._cycles, stamp, states, failed, lost, self._journal.take())

    def hold(self) -> None:
        """Stop now: make the present position the goal of every joint with torque on.

        Raises:
            PortLostError: The port has gone.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        self._inbox.take()
        for joint in self._joints.values():
            joint.hold(self._settings.retries)
        self._prepare_goals(also_silent=True)
        self._port.flush()

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
                    if not joint.stopped and not _relaxed_for_good(joint):
                        unconfirmed.append(joint.name)
        finally:
            self._connected = False
            self._port.close()
        return tuple(unconfirmed)

    # Any thread

    def statistics(self) -> BusStatistics:
        """Return the counters."""
        return BusStatistics(
            self._cycles,
            self._inbox.refused,
            self._inbox.clamped,
            tuple(
                servo.statistics(joint.torque)
                for joint in self._joints.values()
                for servo in joint.servos
            ),
            self._connected and self._look_again_at is None,
            self._port_losses,
            self._port.adapter,
        )

    # Steps of a cycle

    def _port_is_there(self) -> bool:
        """Look for a port that has gone; return whether there is one."""
        if self._look_again_at is None:
            if self._port.is_open:
                return True
            lost = PortLostError(self._port.name, "it went between two cycles")
            if not self._port.comes_back:
                raise lost
            self._lose_port(str(lost))
        now = self._monotonic()
        assert self._look_again_at is not None
        if now < self._look_again_at:
            return False
        self._look_again_at = now + round(self._settings.reconnect_interval * 1e9)
        try:
            self._port.open()
        except PortError:
            return False
        if not any(self._answers(servo) for servo in self._servos()):
            self._port.close()  # it may be somebody else's by now
            return False
        self._look_again_at = None
        self._journal.note_port(EventKind.PORT_RETURNED, f"{self._port.name} is there again")
        return True

    def _servos(self) -> list[BusServo]:
        return [servo for joint in self._joints.values() for servo in joint.servos]

    def _answers(self, servo: BusServo) -> bool:
        return bool(answering([servo.link], attempts=1))

    def _lose_port(self, why: str) -> None:
        self._port.close()
        self._port_losses += 1
        self._look_again_at = self._monotonic()
        self._inbox.take()
        self._supervision.lose_all()
        self._journal.note_port(EventKind.PORT_LOST, why)

    def _take_goals(self) -> None:
        for name, goal in self._inbox.take().items():
            joint = self._joints[name]
            if joint.lost or joint.torque.waits:
                continue  # since the command was accepted
            if joint.torque is not Torque.ON:
                if any(servo.unseen for servo in joint.servos):
                    self._inbox.put_back(name, goal)  # its torque needs to know where it stands
                    continue
                problem = joint.switch_on()
                if problem:
                    self._note(EventKind.TORQUE_FAILED, joint, f"goal dropped: {problem}")
                    continue
                self._note(EventKind.TORQUE_ON, joint, joint.torque.value)
            joint.aim(goal, self._monotonic())

    def _prepare_goals(self, also_silent: bool = False) -> None:
        """Leave the goals with the port, which sends them with its next packet."""
        packets: dict[tuple[int, int, int], dict[int, bytes]] = {}
        for joint in self._joints.values():
            if joint.drives:
                for servo, share in zip(joint.servos, joint.shares(), strict=True):
                    if servo.lost or (
                        (servo.failed_cycles or servo.interrupted) and not also_silent
                    ):
                        continue  # it may have been without power, and must not start by itself
                    model = servo.mount.model
                    key = (model.protocol, model.goal.address, model.goal.length)
                    packets.setdefault(key, {})[servo.id] = share
        for (protocol, address, _), shares in packets.items():
            self._port.sync_write(address, shares, protocol, hold=True)


def _relaxed_for_good(joint: BusJoint) -> bool:
    relaxed = Torque.OFF_UNTIL_COMMANDED if joint.torque is Torque.ON else joint.torque
    try:
        return not joint.switch_off(relaxed)
    except DynamixelError:
        return False
