"""Transactions with servos on one serial line.

Only one device may send at a time: the port waits for a reply before it sends again.

A late reply of protocol 1.0 looks like the reply to the next instruction, because packets have no
numbers. After a failure, the next reads of that servo read more bytes than needed, so that lengths
differ, until the late reply has arrived or 0.3 s have passed. A received packet that equals one
that was sent is the echo of an adapter that joins both directions.
"""

from __future__ import annotations

import shlex
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

from head_tracking.dynamixel.adapter import Adapter, stable_name
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    LineBusyError,
    NotConnectedError,
    PortLostError,
    PortMissingError,
    ReplyTimeoutError,
    advice,
)
from head_tracking.dynamixel.protocol import (
    ALERT,
    BROADCAST_ID,
    STATUS,
    ErrorBits,
    Instruction,
    Status,
    StatusCode,
    decode_status,
    describe_errors,
    describe_status,
    encode_packet,
    find_packet,
    sync_write_packet,
    write_packet,
)
from head_tracking.dynamixel.reading import (
    InstructionPacket,
    ReadGroup,
    instruction_packet,
    single_read_group,
)
from head_tracking.dynamixel.serial_port import (
    LOST,
    SerialDevice,
    check_baud_rate,
    open_serial,
    serial_ports,
)
from head_tracking.dynamixel.waiting import LONGEST, LateReplies, ReplyTimeout

_CHUNK: Final = 4096
_QUIET: Final = 0.0005  # s of silence after which the line is free
_GAP: Final = 0.02  # s to wait, before an instruction, for a gap between packets of another program
_REPLY: Final = 256  # bytes of the longest reply to another program that is searched for
_FILLER: Final = 0.0025  # s; the longest packet at 1 Mbaud
_SUSPECT: Final = 1.0  # s to check for a gap after unexpected packets
_PING_LENGTHS: Final = {1: 0, 2: 3}
_TOOL_BAUD_RATE: Final = 1_000_000  # default of the tool `servo` [bit/s]
_ID_REGISTER: Final = 3  # of protocol 1.0; any model has a register there


class DynamixelPort:
    """A serial port with servos of both protocols. Not thread-safe: one thread owns it.

    Every transaction raises ReplyTimeoutError or CorruptReplyError, both of which are
    CommunicationErrors, or PortLostError (the device has been unplugged).

    Args:
        port_name: Device, such as /dev/ttyUSB0.
        baud_rate: Bits per second; factory default: AX 1000000, X and MX 57600.
        reply_timeout: Time that a servo may take to reply, besides the time on the wire, s; None:
            estimate it (`ReplyTimeout`).
        open_device: Opens a device with the methods of `SerialDevice`, by name and baud rate.
        clock: Monotonic time, s; the clock of the device's deadlines.

    Attributes:
        adapter: Facts about the adapter, once the port has been open.
        stable_name: Name of the adapter by its serial number, once the port has been open; "": it
            has none.
        surplus: Number of unexpected status packets by servo id: two servos have that id, packets
            are repeated, or another program reads.

    Raises:
        ConfigurationError: No servo supports this baud rate, or the timeout is out of range.
    """

    def __init__(
        self,
        port_name: str,
        baud_rate: int = 1_000_000,
        *,
        reply_timeout: float | None = None,
        open_device: Callable[[str, int], Any] = open_serial,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        check_baud_rate(baud_rate)
        if reply_timeout is not None and not 0.0 < reply_timeout < 10.0:
            raise ConfigurationError(
                f"reply_timeout is {reply_timeout}; allowed are 0 to 10 seconds"
            )
        self.name = port_name
        self.baud_rate = baud_rate
        self.clock = clock
        self.adapter = Adapter()
        self.stable_name = ""
        self.surplus: Counter[int] = Counter()
        self._reply_timeout = reply_timeout
        self._open_device = open_device
        self._was_open = False
        self._line: SerialDevice | None = None
        self._loss: Exception | None = None  # why it is not open, until `open` or `close`
        self._timeout = ReplyTimeout(reply_timeout)
        self._late = LateReplies(clock)
        self._seconds_per_byte = 10.0 / baud_rate
        self._sent: deque[bytes] = deque(maxlen=4)
        self._buffer = b""
        self._silence = self._sent_at = 0.0  # s
        self._wire_free = 0.0
        self._suspect_until = 0.0  # unexpected status packets have been received
        self._echoed = False  # the last instruction was received, too

    def back_off(self) -> None:
        """Wait longer for the next reply: this machine may be busy."""
        self._timeout.back_off()

    def servo_command(self, words: str) -> str:
        """Return a command of the tool `servo` for this port, as a user types it."""
        has_rate = self.baud_rate == _TOOL_BAUD_RATE or words.startswith("scan")
        rate = "" if has_rate else f"--baud {self.baud_rate} "
        return f"head_tracking servo --port {shlex.quote(self.name)} {rate}{words}"

    @property
    def is_open(self) -> bool:
        """Whether the device is open."""
        return self._line is not None

    def open(self) -> None:
        """Open and lock the device.

        An adapter that was open before is opened by its serial number (/dev/serial/by-id): after a
        USB reset two adapters may have exchanged their other names.

        Raises:
            PortMissingError: There is no such device, or another adapter has its name.
            PortBusyError: Another program uses it.
            PortPermissionError: The user may not open it.
            BaudRateError: It does not support the baud rate.
            PortError: It is no serial port.
        """
        if self._line is not None:
            return
        try:
            line = self._open_device(self.stable_name or self.name, self.baud_rate)
        except PortMissingError:
            if self._was_open:  # called between cycles, and listing the ports takes long
                raise
            raise PortMissingError(self.name, serial_ports()) from None
        self._was_open = True
        self.stable_name = self.stable_name or stable_name(self.name)
        self.adapter = line.adapter
        self._timeout = ReplyTimeout(self._reply_timeout, line.adapter.latency)
        self._late = LateReplies(self.clock)
        self._sent.clear()
        self._buffer = b""
        self._sent_at = self.clock()
        self._line, self._loss = line, None

    def close(self) -> None:
        """Close the device, if it is open."""
        line, self._line, self._loss = self._line, None, None
        if line is not None:
            line.close()

    def take_silence(self) -> float:
        """Return the longest time without an instruction, s, since the last call."""
        now = self.clock()
        silence = max(self._silence, now - self._sent_at)
        self._silence, self._sent_at = 0.0, now
        return silence

    # Reading

    def read_group(self, group: ReadGroup) -> list[Status | CommunicationError]:
        """Read the same registers of several servos with one packet.

        Servos that reply after a silent one may wait for it for ever, and fail too.

        Returns:
            The reply of each servo, or the error, in the order of `group.ids`.
        """
        line = self._line or self._open_line()
        found: list[Status | CommunicationError] = []
        asked = group
        instructions: tuple[InstructionPacket, ...] = ()
        try:
            if self._buffer or self._suspect_until or self._late.due:
                self._clear(line)
                asked = self._late.unambiguous(group)
            else:
                line.discard_input()
            received_at = self._send(line, asked.replies[0].packet)
            instructions = asked.replies
            for instruction in instructions:
                try:
                    status = self._receive(line, instruction, received_at)
                    if status.error or len(status.data) != asked.length:
                        self._check(status, instruction)
                    found.append(status)
                except CorruptReplyError as cause:
                    found.append(cause)
        except CommunicationError as cause:
            for instruction in instructions[len(found) + 1 :]:
                self._late.add(instruction, self._wire_free)
            found += [cause] * (len(group.ids) - len(found))
        except LOST as cause:
            raise self._lost(cause) from cause
        if asked is not group:
            first = group.address - asked.address
            for index, each in enumerate(found):
                if isinstance(each, Status):
                    found[index] = each._replace(data=each.data[first : first + group.length])
        return found

    def read(self, servo_id: int, address: int, length: int, protocol: int = 1) -> Status:
        """Read `length` bytes from `address` on."""
        group = single_read_group(protocol, address, length, (servo_id,))
        (outcome,) = self.read_group(group)
        if isinstance(outcome, CommunicationError):
            raise outcome
        return outcome

    # Other instructions

    def ping(self, servo_id: int, protocol: int = 1) -> int:
        """Return the error byte of a servo, by a ping.

        While the reply to an earlier ping may arrive, which would be taken for the one to this
        ping, a register is read instead.
        """
        packet = encode_packet(protocol, servo_id, Instruction.PING)
        ping = instruction_packet(packet, protocol, servo_id, _PING_LENGTHS[protocol], "ping")
        self._late.expire()
        if not self._late.similar(ping):
            try:
                return self._command(ping)
            except ReplyTimeoutError:
                # A servo with a voltage error replies to a ping with a packet that equals the ping.
                if protocol == 2 or not self._echoed:
                    raise
        return self.read(servo_id, _ID_REGISTER, 1, protocol).error

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

        With `acknowledged` wait for the status packet, which servos with a Status Return Level
        below 2 do not send.
        """
        packet = write_packet(protocol, servo_id, address, data)
        what = f"write of {len(data)} byte(s) at {address}"
        return self._command(instruction_packet(packet, protocol, servo_id, 0, what), acknowledged)

    def reboot(self, servo_id: int, acknowledged: bool, protocol: int) -> None:
        """Restart a servo of protocol 2.0 or of Feetech; for `acknowledged` see `write`."""
        packet = encode_packet(protocol, servo_id, Instruction.REBOOT)
        reboot = instruction_packet(packet, protocol, servo_id, 0, "reboot")
        self._command(reboot, acknowledged)

    def sync_write(
        self,
        address: int,
        data: Mapping[int, bytes],
        protocol: int = 1,
        *,
        patience: float = 0.0,
    ) -> None:
        """Write the same registers of several servos in one packet; there is no reply.

        Packets that must arrive, such as STOP, have a `patience`: seconds to wait for a gap between
        the packets of another program. Without a gap they are sent all the same: the servos may
        hear them, for example where only the receiver of the adapter is disturbed.
        """
        line = self._line or self._open_line()
        try:
            if patience and (self._suspect_until or line.read(_CHUNK, self.clock())):
                with suppress(LineBusyError):
                    self._wait_for_gap(line, patience)
            self._send(line, sync_write_packet(protocol, address, data))
        except LOST as cause:
            raise self._lost(cause) from cause

    def send_filler(self, protocol: int) -> None:
        """Send bytes without meaning to a servo that may have misheard the length of a packet.

        With protocol 1.0 it waits for the rest until nothing is sent for 100 ms, which never
        happens; with 2.0 for a few milliseconds only.
        """
        if protocol == 1:
            filler = bytes(round(_FILLER / self._seconds_per_byte))
            self._command(instruction_packet(filler, 1, BROADCAST_ID, 0, "filler"), False)

    def find_all(self) -> dict[int, tuple[int, int]]:
        """Return Model Number and firmware of all protocol 2.0 servos, by id, with one packet."""
        line = self._open_line()
        found: dict[int, tuple[int, int]] = {}
        # Each servo waits for those with lower ids; the time is that of dynamixel_sdk.
        seconds = 253 * (14 * self._seconds_per_byte + 0.003) + 0.016
        try:
            with suppress(LineBusyError):
                self._clear(line)
            self._send(line, encode_packet(2, BROADCAST_ID, Instruction.PING))
            deadline = self.clock() + seconds
            while self.clock() < deadline and (data := line.read(_CHUNK, deadline)):
                self._buffer += data
                while (status := self._next(2)[0]) is not None:
                    if len(status.data) == 3:
                        number = int.from_bytes(status.data[:2], "little")
                        found[status.id] = (number, status.data[2])
        except LOST as cause:
            raise self._lost(cause) from cause
        return found

    # One instruction and its reply

    def _command(self, instruction: InstructionPacket, acknowledged: bool = True) -> int:
        """Send an instruction to one servo; return the error byte of its reply, 0 if none comes."""
        line = self._open_line()
        try:
            if acknowledged:
                self._clear(line)
            sent = self._send(line, instruction.packet)
            if not acknowledged:
                return 0
            status = self._receive(line, instruction, sent)
        except LOST as cause:
            raise self._lost(cause) from cause
        self._check(status, instruction)
        return status.error

    def _send(self, line: SerialDevice, packet: bytes) -> float:
        """Write a packet; return when its last byte will have been sent, s."""
        self._sent.append(packet)
        line.write(packet)
        free, now = self._wire_free, self.clock()
        if now - self._sent_at > self._silence:
            self._silence = now - self._sent_at
        self._sent_at = now
        free = (now if now > free else free) + len(packet) * self._seconds_per_byte
        self._wire_free = free
        return free

    def _receive(
        self, line: SerialDevice, instruction: InstructionPacket, received_at: float
    ) -> Status:
        """Wait for the reply of a servo; `received_at`: when it had the instruction, s."""
        _, protocol, _, _, size, prefix, _, _ = instruction
        due = self._wire_free + size * self._seconds_per_byte
        deadline = due + self._timeout.allowance
        buffer = self._buffer or line.read(_CHUNK, deadline)
        while 0 < len(buffer) < size and buffer.startswith(prefix[: len(buffer)]):
            data = line.read(_CHUNK, deadline)
            if not data:
                break
            buffer += data
        packet = buffer[:size]
        if (
            len(packet) == size
            and packet.startswith(prefix)
            and packet not in self._sent
            and not self._late.due
        ):
            now = self.clock()
            # On a simulated line bytes take no time, and the reply may come before `received_at`.
            status = decode_status(protocol, packet, received_at if received_at < now else now)
            if status is not None:
                self._buffer = buffer[size:]
                self._wire_free = now
                self._timeout.learn(now - due)
                return status
        self._buffer = buffer
        status = self._search(line, instruction, due, deadline)
        return status._replace(stamp=min(received_at, self._wire_free))

    def _search(
        self, line: SerialDevice, instruction: InstructionPacket, due: float, deadline: float
    ) -> Status:
        """Wait for the reply of a servo among echoes, noise and unexpected packets."""
        protocol, length = instruction.protocol, instruction.length
        end = max(deadline, due + LONGEST)
        received = len(self._buffer)
        doubtful: Status | None = None
        was_damaged = self._echoed = False
        late = self._late.similar(instruction)  # so many of the first replies may be late ones
        while True:
            before = self._buffer
            status, damaged = self._next(protocol)
            was_damaged = was_damaged or damaged
            if status is not None:
                # the reply was damaged, and this is that of the next servo
                taken = len(before) - len(self._buffer)
                was_noise = was_damaged or (taken > instruction.size and not self._echoed)
                is_next = status.id in instruction.behind and len(status.data) == length
                if was_noise and is_next:
                    self._buffer = before
                    break
                if status.id != instruction.id:
                    self._note_surplus(status.id)
                elif late and len(status.data) == length:
                    late -= 1
                    if doubtful is not None and len(doubtful.data) == length:
                        self._late.remove(protocol, status.id, length)
                    doubtful = status
                elif len(status.data) != length and self._is_late(protocol, status):
                    continue
                elif len(status.data) == length or _refuses(protocol, status):
                    now = self._wire_free = self.clock()
                    self._timeout.learn(now - due)
                    self._late.remove(protocol, status.id, length)
                    return status
                else:
                    self._note_surplus(instruction.id)
                    doubtful = status
                continue
            now = self.clock()
            if damaged and received >= instruction.size and not self._late.due:  # it was the reply
                deadline = min(deadline, max(due, now) + _QUIET)
            elif self._buffer and deadline < now + _QUIET:
                deadline = min(now + _QUIET, end)  # a packet is arriving
            data = line.read(_CHUNK, deadline) if now < end else b""
            if not data:
                break
            received += len(data)
            self._buffer += data
        self._wire_free = self.clock()
        if doubtful is not None:
            return doubtful  # if it does not fit the instruction, the caller raises
        self._late.add(instruction, due)
        if self._buffer or was_damaged:
            raise CorruptReplyError(
                f"servo {instruction.id}: damaged reply; {advice(instruction.id)}"
            )
        raise ReplyTimeoutError(
            f"servo {instruction.id} did not answer a {instruction.description} within "
            f"{self._timeout.allowance * 1e3:.0f} ms on {self.name} at {self.baud_rate} baud"
        )

    def _next(self, protocol: int) -> tuple[Status | None, bool]:
        """Remove the first status packet that is no echo from the buffer.

        Returns:
            The packet, or None; and whether there was a damaged one.
        """
        damaged = False
        while (found := find_packet(protocol, self._buffer)).packet:
            self._buffer = self._buffer[found.end :]
            damaged = damaged or found.damaged
            if found.packet in self._sent:
                self._echoed = True
                continue
            status = decode_status(protocol, found.packet)
            if status is not None:
                return status, damaged
        return None, damaged or found.damaged

    def _is_late(self, protocol: int, status: Status) -> bool:
        """Return whether a reply is a late one; if so, use its delay for the timeout."""
        delay = self._late.remove(protocol, status.id, len(status.data))
        if delay is not None:
            self._timeout.learn(min(delay, 2.0 * self._timeout.allowance, LONGEST))
        return delay is not None

    def _check(self, status: Status, instruction: InstructionPacket) -> None:
        """Raise CorruptReplyError if the servo received damaged bytes, or replied another length.

        A damaged broadcast may be what the servo complains of; then its reply is still to come.
        """
        error, one = status.error, instruction.protocol == 1
        if (error & ErrorBits.CHECKSUM) if one else error & ~ALERT == StatusCode.CRC:
            self._suspect_until = max(self._suspect_until, self.clock() + _GAP)
            raise CorruptReplyError(
                f"servo {status.id} received a damaged {instruction.description}"
            )
        if len(status.data) != instruction.length:
            errors = describe_errors(ErrorBits(error)) if one else describe_status(error)
            raise CorruptReplyError(
                f"servo {status.id} answered a {instruction.description} with {len(status.data)} "
                f"byte(s) of data; error bits: {errors}"
            )

    def _note_surplus(self, servo_id: int) -> None:
        self.surplus[servo_id] += 1
        self._suspect_until = self.clock() + _SUSPECT

    def _clear(self, line: SerialDevice) -> None:
        """Discard what was received; after unexpected packets, wait until the line is free.

        Raises:
            LineBusyError: Another program sends without a pause.
        """
        if self._late.due:
            received = self._buffer + line.read(_CHUNK, self.clock())
            for protocol in (1, 2):
                self._buffer = received
                while (status := self._next(protocol)[0]) is not None:
                    self._is_late(protocol, status)
            self._late.expire()
        if self._suspect_until:
            if self.clock() > self._suspect_until:
                self._suspect_until = 0.0
            else:
                self._wait_for_gap(line, _GAP)
        line.discard_input()
        self._buffer = b""

    def _wait_for_gap(self, line: SerialDevice, patience: float) -> None:
        """Wait until the line is quiet, or a reply to another program has just ended.

        Raises:
            LineBusyError: There was no gap within `patience` seconds.
        """
        deadline = self.clock() + patience
        line.discard_input()  # it is not known when old bytes ended
        self._buffer = b""
        while not self._ends_with_status():
            now = self.clock()
            data = line.read(_CHUNK, now + 2.0 * _QUIET)
            if not data:
                return
            if now > deadline:
                raise LineBusyError(self.name, patience)
            self._buffer = (self._buffer + data)[-_REPLY:]

    def _ends_with_status(self) -> bool:
        """Return whether the received bytes end with a reply, so that no other follows at once.

        In protocol 1.0 a status packet with a non-zero error byte looks like an instruction.
        """
        for protocol in (1, 2):
            rest = self._buffer
            while (found := find_packet(protocol, rest)).packet:
                rest = rest[found.end :]
                code = found.packet[4 if protocol == 1 else 7]
                if not rest and code == (0 if protocol == 1 else STATUS):
                    return True
        return False

    def _open_line(self) -> SerialDevice:
        if self._line is not None:
            return self._line
        if self._loss is not None:
            raise PortLostError(self.name, self._loss)
        raise NotConnectedError(f"{self.name} is not open; is the adapter plugged in?")

    def _lost(self, cause: Exception) -> PortLostError:
        self.close()
        self._loss = cause
        return PortLostError(self.name, cause)


def _refuses(protocol: int, status: Status) -> bool:
    """Return whether a status without data carries an error: the servo refuses the instruction."""
    if status.data:
        return False
    return bool(status.error if protocol == 1 else status.error & ~ALERT)
