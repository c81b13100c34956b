"""A serial port with Dynamixel servos of both protocols."""

from __future__ import annotations

import termios
import time
from collections.abc import Callable, Iterator, Mapping

from head_tracking.dynamixel.adapter import Adapter, stable_name
from head_tracking.dynamixel.answer import Answer, Failure
from head_tracking.dynamixel.conversation import PING_LENGTHS, Conversation
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    NotConnectedError,
    PortLostError,
    PortMissingError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.patience import Patience
from head_tracking.dynamixel.port import ReadGroup, ReadMethod, Reply
from head_tracking.dynamixel.protocol import (
    BROADCAST_ID,
    Instruction,
    Status,
    encode_packet,
    sync_write_packet,
    write_packet,
)
from head_tracking.dynamixel.replies import reply_of
from head_tracking.dynamixel.sdk import SerialDevice, check_baud_rate

_LOST = (OSError, termios.error)


class DynamixelPort:
    """A serial port; implements `ServoPort`.

    Args:
        port_name: Device, such as /dev/ttyUSB0.
        baud_rate: Bits per second; AX servos leave the factory with 1000000, X and MX with 57600.
        reply_timeout: Time a servo may take to answer, s, added to the time on the wire; None: as
            long as answers take on this port, and a margin (`Patience`).
        write_timeout: Time the device may refuse to take data, s.
        open_device: Opens the device.
        clock: Monotonic time, s; the same that the device's line counts by.

    Raises:
        ConfigurationError: The SDK cannot set this baud rate, or a timeout is not above 0.
    """

    def __init__(
        self,
        port_name: str,
        baud_rate: int = 1_000_000,
        *,
        reply_timeout: float | None = None,
        write_timeout: float = 0.1,
        open_device: Callable[[str, int], SerialDevice] = SerialDevice,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        check_baud_rate(baud_rate)
        for name, value in (("reply_timeout", reply_timeout), ("write_timeout", write_timeout)):
            if value is not None and not 0.0 < value < 10.0:
                raise ConfigurationError(f"{name} is {value}; allowed are 0 to 10 seconds")
        self._name = port_name
        self._baud_rate = baud_rate
        self._reply_timeout = reply_timeout
        self._write_timeout = write_timeout
        self._open_device = open_device
        self._clock = clock
        self._other_name = ""  # by its serial number, once it has been there
        self._device: SerialDevice | None = None
        self._conversation: Conversation | None = None
        self._patience = Patience(reply_timeout)
        self._adapter = Adapter()

    @property
    def name(self) -> str:
        """Device, for messages."""
        return self._name

    @property
    def baud_rate(self) -> int:
        """Bits per second."""
        return self._baud_rate

    @property
    def adapter(self) -> Adapter:
        """What is known about the device since it was opened."""
        return self._adapter

    @property
    def is_open(self) -> bool:
        """Whether the device is open."""
        return self._device is not None

    @property
    def comes_back(self) -> bool:
        """Whether the device, once gone, may be found again under its name.

        A pseudo-terminal never is: its number goes to the next program that asks for one. A link
        to one may be.
        """
        return not self._name.startswith("/dev/pts/")

    def open(self) -> None:
        """Open the device and lock it, so that no second program disturbs the bus.

        One that was there before is also looked for by its serial number (/dev/serial/by-id).

        Raises:
            PortMissingError: There is no such device.
            PortBusyError: Another program holds it.
            PortPermissionError: The user may not open it.
            PortError: It is no serial port, cannot do the baud rate, or fails for another reason.
        """
        if self._device is not None:
            return
        try:
            device = self._open_device(self._name, self._baud_rate)
        except PortMissingError:
            if not self._other_name:
                raise
            device = self._open_device(self._other_name, self._baud_rate)
        self._other_name = self._other_name or stable_name(self._name)
        self._adapter = device.adapter
        self._patience = Patience(self._reply_timeout, device.adapter.latency)
        self._conversation = Conversation(
            device.line, self._baud_rate, self._patience, self._write_timeout, self._clock
        )
        self._device = device

    def close(self) -> None:
        """Close the device; does nothing when it is closed or lost."""
        device, self._device = self._device, None
        self._conversation = None
        if device is not None:
            device.close()

    def ping(self, servo_id: int, protocol: int = 1) -> int:
        """Ask a servo whether it is there; return its error byte.

        Raises:
            CommunicationError: No usable answer.
            PortLostError: The device has gone.
        """
        conversation = self._open_conversation()
        try:
            answer = conversation.ping(protocol, servo_id)
        except _LOST as cause:
            raise self._lost(cause) from cause
        return self._reply(protocol, servo_id, answer, PING_LENGTHS[protocol], "ping").error

    def read(self, servo_id: int, address: int, length: int, protocol: int = 1) -> Reply:
        """Read `length` bytes from `address` on.

        Raises:
            CommunicationError: No usable answer.
            PortLostError: The device has gone.
        """
        conversation = self._open_conversation()
        try:
            answer = conversation.read(protocol, servo_id, address, length)
        except _LOST as cause:
            raise self._lost(cause) from cause
        if isinstance(answer, Status) and len(answer.data) == length and not answer.error:
            return Reply(answer.data, 0)
        what = f"read of {length} byte(s) at {address}"
        return self._reply(protocol, servo_id, answer, length, what)

    def read_group(self, group: ReadGroup) -> Iterator[Reply | CommunicationError]:
        """Read from several servos; yield what became of each, in the order of the ids.

        The first question has gone out when this returns, and the next one when an answer is
        handed out: no other method may be used then, except a sync write that is held. After a
        failure nothing is under way.

        Raises:
            PortLostError: The device has gone.
        """
        conversation = self._open_conversation()
        try:
            return self._replies(group, _answers(conversation, group))
        except _LOST as cause:
            raise self._lost(cause) from cause

    def _replies(
        self, group: ReadGroup, answers: Iterator[Answer]
    ) -> Iterator[Reply | CommunicationError]:
        length = group.length
        ids = iter(group.ids)
        try:
            for answer in answers:
                servo_id = next(ids)
                if type(answer) is Status and not answer.error and len(answer.data) == length:
                    yield Reply(answer.data, 0)
                    continue
                what = f"read of {length} byte(s) at {group.address}"
                try:
                    yield self._reply(group.protocol, servo_id, answer, length, what)
                except CommunicationError as failure:
                    yield failure
        except _LOST as cause:
            raise self._lost(cause) from cause

    def write(
        self,
        servo_id: int,
        address: int,
        data: bytes,
        *,
        acknowledged: bool = True,
        protocol: int = 1,
    ) -> int:
        """Write bytes from `address` on; return the servo's error byte.

        With `acknowledged` its status is waited for; servos with a Status Return Level below 2
        send none.

        Raises:
            CommunicationError: No usable answer.
            PortLostError: The device has gone.
        """
        packet = write_packet(protocol, servo_id, address, data)
        if not acknowledged:
            self._tell(packet)
            return 0
        answer = self._ask(protocol, servo_id, packet, 0)
        what = f"write of {len(data)} byte(s) at {address}"
        return self._reply(protocol, servo_id, answer, 0, what).error

    def sync_write(
        self, address: int, data: Mapping[int, bytes], protocol: int = 1, *, hold: bool = False
    ) -> None:
        """Write the same registers of several servos in one packet, by id; nobody answers.

        With `hold` it is sent together with the next question, or by `flush`.

        Raises:
            CommunicationError: The packet cannot be sent.
            PortLostError: The device has gone.
        """
        if not data:
            return
        packet = sync_write_packet(protocol, address, data)
        if hold:
            self._open_conversation().hold(packet)
        else:
            self._tell(packet)

    def flush(self) -> None:
        """Send what is held.

        Raises:
            PortLostError: The device has gone.
        """
        try:
            self._open_conversation().flush()
        except _LOST as cause:
            raise self._lost(cause) from cause

    def reboot(self, servo_id: int) -> None:
        """Restart a protocol 2.0 servo; it answers nothing for a while.

        Raises:
            CommunicationError: No usable answer.
            PortLostError: The device has gone.
        """
        packet = encode_packet(2, servo_id, Instruction.REBOOT)
        self._reply(2, servo_id, self._ask(2, servo_id, packet, 0), 0, "reboot")

    def find_all(self) -> dict[int, tuple[int, int]]:
        """Return Model Number and firmware of all protocol 2.0 servos, by id, with one packet.

        Raises:
            PortLostError: The device has gone.
        """
        packet = encode_packet(2, BROADCAST_ID, Instruction.PING)
        # Each servo waits until those with lower ids have had their time; dynamixel_sdk reckons so.
        seconds = 253 * (14 * 10.0 / self._baud_rate + 0.003) + 0.016
        try:
            found = self._open_conversation().collect(2, packet, seconds)
        except _LOST as cause:
            raise self._lost(cause) from cause
        return {
            status.id: (int.from_bytes(status.data[:2], "little"), status.data[2])
            for status in found
            if len(status.data) == 3
        }

    def _ask(self, protocol: int, servo_id: int, packet: bytes, length: int) -> Answer:
        conversation = self._open_conversation()
        try:
            return conversation.ask(protocol, servo_id, packet, length)
        except _LOST as cause:
            raise self._lost(cause) from cause

    def _tell(self, packet: bytes) -> None:
        conversation = self._open_conversation()
        conversation.hold(packet)
        try:
            conversation.flush()
        except _LOST as cause:
            raise self._lost(cause) from cause

    def _reply(self, protocol: int, servo_id: int, answer: Answer, length: int, what: str) -> Reply:
        """Return what an answer says, or raise why it says nothing."""
        if answer is Failure.SILENT:
            raise ReplyTimeoutError(
                f"servo {servo_id} did not answer a {what} within "
                f"{self._patience.allowance * 1e3:.0f} ms on {self._name} at {self._baud_rate} baud"
            )
        return reply_of(protocol, servo_id, answer, length, what)

    def _open_conversation(self) -> Conversation:
        if self._conversation is None:
            raise NotConnectedError(f"{self._name} is not open; call open() first")
        return self._conversation

    def _lost(self, cause: Exception) -> PortLostError:
        self.close()
        return PortLostError(self._name, cause)


def _answers(conversation: Conversation, group: ReadGroup) -> Iterator[Answer]:
    """Ask what the group wants to know; the first question has gone out when this returns."""
    if group.method is ReadMethod.EACH or len(group.ids) == 1:
        return conversation.read_each(group.protocol, group.ids, group.address, group.length)
    return conversation.read_together(group.method, group.ids, group.address, group.length)
