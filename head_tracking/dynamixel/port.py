"""Transactions: what is asked of servos on one serial line, and what they reply.

Only one device may send at a time, so that nothing is asked while a reply may be on the wire.

Protocol 1.0 has no sequence numbers: a reply that comes late looks like the reply to the next
request. After a failure the next requests to that servo ask for more bytes than needed, until the
late reply has come or a second has passed, so that the lengths differ. A received packet
that equals one that was sent is the echo of an adapter that joins both directions.
"""

from __future__ import annotations

import termios
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final

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
    split_joint_status,
    sync_write_packet,
    write_packet,
)
from head_tracking.dynamixel.reading import (
    ReadGroup,
    ReadMethod,
    Reply,
    Request,
    request_for,
    single_read_group,
)
from head_tracking.dynamixel.serial_port import (
    SerialDevice,
    SerialLine,
    check_baud_rate,
    serial_ports,
)
from head_tracking.dynamixel.waiting import LONGEST, LateReplies, ReplyTimeout

_LOST: Final = (OSError, termios.error)
_CHUNK: Final = 4096
_WRITE_TIMEOUT: Final = 0.1  # s for which a device may take no data
_QUIET: Final = 0.0005  # s of silence after which a line on which something went wrong is free
_GAP: Final = 0.02  # s to wait for a gap between the packets of another program, before a request
_SUSPECT: Final = 1.0  # s for which a line with surplus packets is listened to before a request
_PING_LENGTHS: Final = {1: 0, 2: 3}
_ID_REGISTER: Final = 3  # of protocol 1.0


class DynamixelPort:
    """A serial port with Dynamixel servos of both protocols. Not thread-safe: one thread owns it.

    Every transaction raises ReplyTimeoutError (no reply in time), CorruptReplyError (a reply that
    cannot be used), both of which are CommunicationErrors, or PortLostError (the device has gone).

    Args:
        port_name: Device, such as /dev/ttyUSB0.
        baud_rate: Bits per second; AX servos leave the factory with 1000000, X and MX with 57600.
        reply_timeout: Time a servo may take to answer, s, added to the time on the wire; None: as
            long as replies take on this port, and a margin (`ReplyTimeout`).
        open_device: Opens the device.
        clock: Monotonic time, s; the same that the device's line counts by.

    Attributes:
        name: Device, for messages.
        baud_rate: Bits per second.
        clock: Monotonic time, s.
        adapter: What is known about the device since it was opened.
        stable_name: Of the device by its serial number, once it has been open; "": it has none.
        searches: Replies that were not just what was expected, and had to be searched for.
        surplus: Number of status packets that were not asked for, by servo id: two servos have that
            id, packets are repeated, or another program asks.

    Raises:
        ConfigurationError: No servo knows this baud rate, or the timeout is not above 0.
    """

    def __init__(
        self,
        port_name: str,
        baud_rate: int = 1_000_000,
        *,
        reply_timeout: float | None = None,
        open_device: Callable[[str, int], SerialDevice] = SerialDevice,
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
        self.surplus: Counter[int] = Counter()
        self.searches = 0
        self._reply_timeout = reply_timeout
        self._open_device = open_device
        self._was_open = False
        self.stable_name = ""
        self._device: SerialDevice | None = None
        self._line: SerialLine | None = None
        self._timeout = ReplyTimeout(reply_timeout)
        self._late = LateReplies(clock)
        self._seconds_per_byte = 10.0 / baud_rate
        self._sent: deque[bytes] = deque(maxlen=4)
        self._buffer = b""
        self._wire_free = 0.0
        self._suspect_until = 0.0  # surplus status packets have come
        self._echoed = False  # the last request came back

    def back_off(self) -> None:
        """Wait longer for the next reply: the machine may be too busy to take it in time."""
        self._timeout.back_off()

    @property
    def is_open(self) -> bool:
        """Whether the device is open; a lost one is not."""
        return self._device is not None

    @property
    def comes_back(self) -> bool:
        """Whether the device, once gone, may be found again under its name.

        A pseudo-terminal never is: its number goes to the next program that asks for one. A link
        to one may be.
        """
        return not self.name.startswith("/dev/pts/")

    def open(self) -> None:
        """Open the device and lock it, so that no second program disturbs the bus.

        An adapter that was open before is opened by its serial number (/dev/serial/by-id): after a
        USB reset two adapters may have swapped their other names.

        Raises:
            PortMissingError: There is no such device, or another adapter has its name now.
            PortBusyError: Another program holds it.
            PortPermissionError: The user may not open it.
            PortError: It is no serial port, cannot do the baud rate, or fails for another reason.
        """
        if self._device is not None:
            return
        try:
            device = self._open_device(self.stable_name or self.name, self.baud_rate)
        except PortMissingError:
            if self._was_open:  # searched between cycles: a list of all ports takes too long
                raise
            raise PortMissingError(self.name, serial_ports()) from None
        self._was_open = True
        self.stable_name = self.stable_name or stable_name(self.name)
        self.adapter = device.adapter
        self._timeout = ReplyTimeout(self._reply_timeout, device.adapter.latency)
        self._late = LateReplies(self.clock)
        self._sent.clear()
        self._buffer = b""
        self._device, self._line = device, device.line

    def close(self) -> None:
        """Close the device; does nothing when it is closed or lost."""
        device, self._device = self._device, None
        self._line = None
        if device is not None:
            device.close()

    # Reading

    def read_group(self, group: ReadGroup) -> list[Reply | CommunicationError]:
        """Read the same registers of several servos with one packet; see `ReadGroup`.

        Behind a silent servo the others may wait for ever, so that they count as silent too.

        Returns:
            In the order of their ids the reply of each servo, or why there is none.
        """
        line = self._line or self._open_line()
        found: list[Reply | CommunicationError] = []
        asked = group
        requests: tuple[Request, ...] = ()
        try:
            if self._buffer or self._suspect_until or self._late.due:
                self._clear()
                asked = self._late.distinct(group)
            else:
                line.discard_input()
            stamp = self._send(asked.requests[0].packet)
            requests = asked.requests
            for request in requests:
                try:
                    status = self._receive(request)
                    for each in _split(asked, status) if request.id == BROADCAST_ID else (status,):
                        data = each.data
                        if each.error or len(data) != asked.length:
                            _check(asked.protocol, each, asked.length, request.what)
                        if asked is not group:
                            data = data[group.address - asked.address :][: group.length]
                        if group.plausible is not None and not group.plausible(data):
                            raise CorruptReplyError(f"servo {each.id}: impossible data {data!r}")
                        end = self._wire_free  # where bytes take no time, it may come too early
                        found.append(Reply(data, each.error, stamp if stamp < end else end))
                except CorruptReplyError as cause:
                    if request.id == BROADCAST_ID:
                        raise
                    found.append(cause)
        except CommunicationError as cause:
            for request in requests[len(found) + 1 :]:
                self._late.add(request, self._wire_free)
            found += [cause] * (len(group.ids) - len(found))
        except _LOST as cause:
            raise self._lost(cause) from cause
        return found

    def read(self, servo_id: int, address: int, length: int, protocol: int = 1) -> Reply:
        """Read `length` bytes from `address` on."""
        group = single_read_group(ReadMethod.EACH, protocol, address, length, (servo_id,))
        (outcome,) = self.read_group(group)
        if isinstance(outcome, CommunicationError):
            raise outcome
        return outcome

    # Other instructions

    def ping(self, servo_id: int, protocol: int = 1) -> int:
        """Ask a servo whether it is there; return its error byte."""
        packet = encode_packet(protocol, servo_id, Instruction.PING)
        request = request_for(packet, protocol, servo_id, _PING_LENGTHS[protocol], "ping")
        self._late.expect(request)  # also a late reply says that it is there
        try:
            return self._command(request)
        except ReplyTimeoutError:
            # The reply to a ping of a servo with a voltage error is the ping's own echo.
            if protocol == 2 or not self._echoed:
                raise
            self.read(servo_id, _ID_REGISTER, 1)
            return packet[4]

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
        """
        packet = write_packet(protocol, servo_id, address, data)
        what = f"write of {len(data)} byte(s) at {address}"
        return self._command(request_for(packet, protocol, servo_id, 0, what), acknowledged)

    def reboot(self, servo_id: int, protocol: int = 2) -> None:
        """Restart a servo of protocol 2.0 or of Feetech, which sends no reply; it is deaf then."""
        packet = encode_packet(protocol, servo_id, Instruction.REBOOT)
        self._command(request_for(packet, protocol, servo_id, 0, "reboot"), protocol == 2)

    def sync_write(
        self,
        address: int,
        data: Mapping[int, bytes],
        protocol: int = 1,
        *,
        patience: float = 0.0,
    ) -> None:
        """Write the same registers of several servos in one packet, by id; there is no reply.

        Args:
            address: First register byte.
            data: What to write, by servo id.
            protocol: 1 or 2.
            patience: How long to wait for a gap between the packets of another program, s; 0: do
                not wait. For what must reach the servos, such as STOP.

        Raises:
            LineBusyError: There was no gap; nothing was sent.
        """
        if not data:
            return
        line = self._line or self._open_line()
        try:
            if patience and (self._suspect_until or line.read(_CHUNK, self.clock())):
                self._wait_for_gap(patience)
            self._send(sync_write_packet(protocol, address, data))
        except _LOST as cause:
            raise self._lost(cause) from cause

    def find_all(self) -> dict[int, tuple[int, int]]:
        """Return Model Number and firmware of all protocol 2.0 servos, by id, with one packet."""
        line = self._open_line()
        found: dict[int, tuple[int, int]] = {}
        # Each servo waits until those with lower ids have had their time; dynamixel_sdk reckons so.
        seconds = 253 * (14 * self._seconds_per_byte + 0.003) + 0.016
        try:
            with suppress(LineBusyError):
                self._clear()
            self._send(encode_packet(2, BROADCAST_ID, Instruction.PING))
            deadline = self.clock() + seconds
            while self.clock() < deadline and (data := line.read(_CHUNK, deadline)):
                self._buffer += data
                while (status := self._next(2)[0]) is not None:
                    if len(status.data) == 3:
                        number = int.from_bytes(status.data[:2], "little")
                        found[status.id] = (number, status.data[2])
        except _LOST as cause:
            raise self._lost(cause) from cause
        return found

    # One request and its reply

    def _command(self, request: Request, acknowledged: bool = True) -> int:
        """Send an instruction to one servo; return the error byte of its reply, 0 if none comes."""
        self._open_line()
        try:
            if acknowledged:
                self._clear()
            self._send(request.packet)
            if not acknowledged:
                return 0
            status = self._receive(request)
        except _LOST as cause:
            raise self._lost(cause) from cause
        _check(request.protocol, status, request.length, request.what)
        return status.error

    def _send(self, packet: bytes) -> float:
        """Write a packet; return when it will have gone over the wire, s."""
        line = self._line
        assert line is not None
        self._sent.append(packet)
        line.write(packet, _WRITE_TIMEOUT)
        free, now = self._wire_free, self.clock()
        free = (now if now > free else free) + len(packet) * self._seconds_per_byte
        self._wire_free = free
        return free

    def _receive(self, request: Request) -> Status:
        """Wait for the reply of a servo."""
        line = self._line
        assert line is not None
        size, prefix = request.size, request.prefix
        due = self._wire_free + size * self._seconds_per_byte
        deadline = due + self._timeout.allowance
        packet = buffer = self._buffer or line.read(_CHUNK, deadline)
        while 0 < len(buffer) < size and buffer.startswith(prefix[: len(buffer)]):
            data = line.read(_CHUNK, deadline)
            if not data:
                break
            packet = buffer = buffer + data
        if len(packet) > size:
            packet = packet[:size]
        if packet.startswith(prefix) and len(packet) == size and not self._late.due:
            status = decode_status(request.protocol, packet)
            if status is not None and packet not in self._sent:
                self._buffer = buffer[size:]
                now = self._wire_free = self.clock()
                self._timeout.learn(now - due)
                return status
        self._buffer = buffer
        self.searches += 1
        return self._search(request, due, deadline)

    def _search(self, request: Request, due: float, deadline: float) -> Status:
        """Wait for the reply of a servo among echoes, noise, and packets that are not wanted."""
        line = self._line
        assert line is not None
        protocol = request.protocol
        end = max(deadline, due + LONGEST)
        received = len(self._buffer)
        doubtful: Status | None = None
        was_damaged = self._echoed = False
        ambiguous = self._late.resembles(request)  # the first of two replies may be the late one
        while True:
            status, damaged = self._next(protocol)
            was_damaged = was_damaged or damaged
            if status is not None:
                if status.id != request.id:
                    self._note_surplus(status.id)
                elif ambiguous and doubtful is None and len(status.data) == request.length:
                    doubtful = status
                elif len(status.data) == request.length or _refuses(protocol, status):
                    now = self._wire_free = self.clock()
                    self._timeout.learn(now - due)
                    if ambiguous:
                        self._late.take(protocol, status)
                    return status
                elif not self._is_late(protocol, status):
                    self._note_surplus(request.id)
                    doubtful = status
                continue
            now = self.clock()
            if damaged and received >= request.size:  # that was it
                deadline = min(deadline, max(due, now) + _QUIET)
            elif self._buffer and deadline < now + _QUIET:
                deadline = min(now + _QUIET, end)  # a packet is coming in
            data = line.read(_CHUNK, deadline) if now < end else b""
            if not data:
                break
            received += len(data)
            self._buffer += data
        self._wire_free = self.clock()
        if doubtful is not None:
            return doubtful  # if it does not fit the request, the caller raises
        self._late.add(request, due)
        if self._buffer or was_damaged:
            raise CorruptReplyError(f"servo {request.id}: damaged reply")
        raise ReplyTimeoutError(
            f"servo {request.id} did not answer a {request.what} within "
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
        """Return whether a reply is a late one; if so, learn from it how long replies take."""
        late = self._late.take(protocol, status)
        if late is not None:
            self._timeout.learn(min(late, 2.0 * self._timeout.allowance, LONGEST))
        return late is not None

    def _note_surplus(self, servo_id: int) -> None:
        self.surplus[servo_id] += 1
        self._suspect_until = self.clock() + _SUSPECT

    def _clear(self) -> None:
        """Forget what was received; after surplus packets, wait until the line is free.

        Raises:
            LineBusyError: Another program sends without a pause.
        """
        line = self._line
        assert line is not None
        if self._late.due:
            received = self._buffer + line.read(_CHUNK, self.clock())
            for protocol in (1, 2):
                self._buffer = received
                while (status := self._next(protocol)[0]) is not None:
                    self._is_late(protocol, status)
            self._late.forget()
        if self._suspect_until:
            if self.clock() > self._suspect_until:
                self._suspect_until = 0.0
            else:
                self._wait_for_gap(_GAP)
        line.discard_input()
        self._buffer = b""

    def _wait_for_gap(self, patience: float) -> None:
        """Wait until the line is quiet, or a reply to another program has just ended.

        Raises:
            LineBusyError: There was no gap for so long, s.
        """
        line = self._line
        assert line is not None
        deadline = self.clock() + patience
        line.discard_input()  # when old bytes ended is not known
        self._buffer = b""
        while not self._ends_with_status():
            now = self.clock()
            data = line.read(_CHUNK, now + 2.0 * _QUIET)
            if not data:
                return
            if now > deadline:
                raise LineBusyError(self.name, patience)
            self._buffer = (self._buffer + data)[-_CHUNK:]

    def _ends_with_status(self) -> bool:
        """Return whether what was received ends with a reply, so that no other follows at once.

        In protocol 1.0 a status packet whose error byte is not 0 looks like an instruction.
        """
        for protocol in (1, 2):
            rest = self._buffer
            while (found := find_packet(protocol, rest)).packet:
                rest = rest[found.end :]
                code = found.packet[4 if protocol == 1 else 7]
                if not rest and code == (0 if protocol == 1 else STATUS):
                    return True
        return False

    def _open_line(self) -> SerialLine:
        if self._line is None:
            raise NotConnectedError(f"{self.name} is not open; call open() first")
        return self._line

    def _lost(self, cause: Exception) -> PortLostError:
        self.close()
        return PortLostError(self.name, cause)


def _split(group: ReadGroup, joint: Status) -> list[Status]:
    """Return the reply of each servo in the joint reply to a fast sync read."""
    shares = split_joint_status(joint, group.length, len(group.ids))
    if [share.id for share in shares] != list(group.ids):
        raise CorruptReplyError(f"damaged reply to a fast sync read of {group.ids}")
    return shares


def _refuses(protocol: int, status: Status) -> bool:
    """Return whether a status without data carries an error: the servo refuses the request."""
    if status.data:
        return False
    return bool(status.error if protocol == 1 else status.error & ~ALERT)


def _check(protocol: int, status: Status, length: int, what: str) -> None:
    """Refuse the reply of a servo that received a damaged request, or of another length."""
    error = status.error
    if (error & ErrorBits.CHECKSUM) if protocol == 1 else error & ~ALERT == StatusCode.CRC:
        raise CorruptReplyError(f"servo {status.id} received a damaged {what}")
    if len(status.data) != length:
        errors = describe_errors(ErrorBits(error)) if protocol == 1 else describe_status(error)
        raise CorruptReplyError(
            f"servo {status.id} answered a {what} with {len(status.data)} byte(s) of data; error "
            f"bits: {errors}"
        )
