"""Transactions: what is asked of servos on one serial line, and what they reply.

Only one may speak at a time. So nothing is asked while a reply may still be on the wire, and what
cannot be used is asked for again before anything else is.

Protocol 1.0 has no sequence numbers: a reply that comes late looks like the reply to the next
request. After a failure the next requests to that servo ask for some bytes more than needed, until
the late reply has come or a second has passed, so that its length gives it away. What is received
and equals what was sent is the echo of an adapter that joins both directions.
"""

from __future__ import annotations

import termios
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Final, NamedTuple

from head_tracking.dynamixel.adapter import Adapter, stable_name
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    NotConnectedError,
    PortLostError,
    PortMissingError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.protocol import (
    ALERT,
    BROADCAST_ID,
    HEADER,
    OVERHEAD,
    STATUS,
    ErrorBits,
    Instruction,
    Status,
    StatusCode,
    bulk_read_packet,
    crc16,
    describe_errors,
    describe_status,
    encode_packet,
    find_status,
    joint_status_size,
    read_packet,
    split_joint_status,
    sync_read_packet,
    sync_write_packet,
    write_packet,
)
from head_tracking.dynamixel.serial_port import Line, SerialDevice, check_baud_rate, serial_ports

_LOST: Final = (OSError, termios.error)
_CHUNK: Final = 4096
_QUIET: Final = 0.0005  # s of silence after which a line on which something went wrong is free
_SHORTEST: Final = 0.0017
"""s. A quiet machine wakes the reader up within a millisecond; less would cry wolf."""
_LONGEST: Final = 0.025
"""s. Leaves room for an FTDI adapter's 16 ms, which it takes unless told otherwise."""
_MARGIN: Final = 0.0012
_DEVIATIONS: Final = 6.0
_GAIN: Final = 1.0 / 16.0
_SUSPECT: Final = 1.0  # s for which a line on which somebody said too much is listened to
_FORGOTTEN: Final = 1.0
"""s after which no reply is still on its way, through whatever adapter."""
_MOST_EXTRA: Final = 24  # bytes
_PING_LENGTHS: Final = {1: 0, 2: 3}


class Reply(NamedTuple):
    """What a servo replied to a read.

    Attributes:
        data: Exactly the bytes that were asked for.
        error: The error byte of the status packet. In protocol 1.0 its bits are the servo's state
            (`ErrorBits`), in protocol 2.0 only the alert bit is; the data are valid all the same.
        stamp: When the servo had received the request, on the port's clock, s.
    """

    data: bytes
    error: int
    stamp: float = 0.0


class Failed(NamedTuple):
    """A read that failed, each time it was tried.

    Attributes:
        causes: Why, once for each try.
    """

    causes: tuple[CommunicationError, ...]


class Retried(NamedTuple):
    """A read that was successful in the end.

    Attributes:
        reply: What was read.
        causes: Why it failed before, once for each try.
    """

    reply: Reply
    causes: tuple[CommunicationError, ...]


class ReadMethod(Enum):
    """How the same registers of several servos are read."""

    EACH = "one packet for each"
    BULK = "bulk read"
    SYNC = "sync read"
    FAST_SYNC = "fast sync read"


Plausible = Callable[[bytes], bool]


@dataclass(frozen=True, slots=True)
class ReadGroup:
    """The same registers of one or more servos.

    Attributes:
        method: How they are read.
        protocol: Their protocol, 1 or 2.
        address: First register byte.
        length: Number of bytes.
        ids: The servos.
        plausible: Says whether a servo can have said that; the checksum of protocol 1.0 is weak,
            two damaged bits can cancel each other out.
    """

    method: ReadMethod
    protocol: int
    address: int
    length: int
    ids: tuple[int, ...]
    plausible: Plausible | None = None


class ReplyTimeout:
    """How long a reply is waited for besides its time on the wire.

    Follows the time between the last byte of a request and the last byte of its reply: the servo's
    return delay, the adapter's latency and the time until this program runs. Mean and mean
    deviation are followed as TCP does it (RFC 6298).

    Args:
        fixed: Always allow this time, s, instead; None follows.
        adapter: What the adapter is known to take, s; None if it does not tell.

    Attributes:
        allowance: That time, s.
    """

    def __init__(self, fixed: float | None = None, adapter: float | None = None) -> None:
        self._fixed = fixed
        self._mean = self._deviation = -1.0
        if fixed is not None:
            self.allowance = fixed
        else:
            self.allowance = _LONGEST if adapter is None else min(_LONGEST, adapter + 0.008)

    def learn(self, latency: float) -> None:
        """Take account of a reply, unless it took too long to ever wait for; s."""
        if self._fixed is not None or latency > _LONGEST:
            return
        mean = self._mean
        if self._deviation < 0.0:
            self._mean, self._deviation = latency, latency / 2.0
        else:
            error = latency - mean
            self._mean = mean + _GAIN * error
            self._deviation += _GAIN * ((error if error > 0.0 else -error) - self._deviation)
        wanted = self._mean + _DEVIATIONS * self._deviation + _MARGIN
        if wanted < _SHORTEST:
            wanted = _SHORTEST
        self.allowance = wanted if wanted < _LONGEST else _LONGEST

    def learn_late(self, latency: float) -> None:
        """Take account of a reply that was found after that time, s, and came before."""
        self.learn(min(latency, 2.0 * self.allowance, _LONGEST))


class LateReplies:
    """Replies that nobody waits for any more: by protocol and id, their lengths and due times.

    Args:
        clock: Monotonic time, s.

    Attributes:
        due: When each of them was due, s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.due: dict[tuple[int, int], dict[int, float]] = {}

    def add(self, protocol: int, servo_id: int, length: int, due: float) -> None:
        """Note that a reply with so many bytes of data may still come."""
        self.due.setdefault((protocol, servo_id), {})[length] = due

    def extra(self, protocol: int, ids: Iterable[int], length: int) -> int | None:
        """Return how many bytes more to ask for, so that no late reply has the length of the new.

        Returns:
            That number; None if there is none, after many failures in a second.
        """
        if not self.due:
            return 0
        self.forget()
        late: set[int] = set()
        for servo_id in ids:
            late.update(self.due.get((protocol, servo_id), ()))
        return next((extra for extra in range(_MOST_EXTRA + 1) if length + extra not in late), None)

    def take(self, protocol: int, servo_id: int, length: int) -> float | None:
        """Note that such a reply has come; return how late it is, s, or None if none is due."""
        due = self.due.get((protocol, servo_id))
        if due is None:
            return None
        time_due = due.pop(length, None)
        if not due:
            del self.due[protocol, servo_id]
        return None if time_due is None else self._clock() - time_due

    def forget(self) -> None:
        """Drop what is too old to come."""
        now = self._clock()
        for key, late in list(self.due.items()):
            recent = {length: due for length, due in late.items() if now - due <= _FORGOTTEN}
            if recent:
                self.due[key] = recent
            else:
                del self.due[key]


class DynamixelPort:
    """A serial port with Dynamixel servos of both protocols. Not thread-safe: one thread owns it.

    Every transaction raises ReplyTimeoutError (no reply in time), CorruptReplyError (a reply that
    cannot be used), both of which are CommunicationErrors, or PortLostError (the device has gone).

    Args:
        port_name: Device, such as /dev/ttyUSB0.
        baud_rate: Bits per second; AX servos leave the factory with 1000000, X and MX with 57600.
        reply_timeout: Time a servo may take to answer, s, added to the time on the wire; None: as
            long as replies take on this port, and a margin (`ReplyTimeout`).
        write_timeout: Time the device may refuse to take data, s.
        open_device: Opens the device.
        clock: Monotonic time, s; the same that the device's line counts by.

    Attributes:
        name: Device, for messages.
        baud_rate: Bits per second.
        clock: Monotonic time, s.
        adapter: What is known about the device since it was opened.
        surplus: Status packets that nobody had asked for, by servo id: two servos have that id, or
            somebody repeats packets.

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
        self.name = port_name
        self.baud_rate = baud_rate
        self.clock = clock
        self.adapter = Adapter()
        self.surplus: Counter[int] = Counter()
        self._reply_timeout = reply_timeout
        self._write_timeout = write_timeout
        self._open_device = open_device
        self._was_open = False
        self._stable_name = ""  # by its serial number, once it has been open
        self._device: SerialDevice | None = None
        self._line: Line | None = None
        self._timeout = ReplyTimeout(reply_timeout)
        self._late = LateReplies(clock)
        self._seconds_per_byte = 10.0 / baud_rate
        self._sent: deque[bytes] = deque(maxlen=4)
        self._held = b""
        self._buffer = bytearray()
        self._wire_free = 0.0
        self._suspect_until = 0.0  # somebody sends more status packets than were asked for
        self._echoes: bool | None = None
        self._mirrored = False  # the last request came back

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
            device = self._open_device(self._stable_name or self.name, self.baud_rate)
        except PortMissingError:
            if self._was_open:  # it is looked for between cycles, where a list takes too long
                raise
            raise PortMissingError(self.name, serial_ports()) from None
        self._was_open = True
        self._stable_name = self._stable_name or stable_name(self.name)
        self.adapter = device.adapter
        self._timeout = ReplyTimeout(self._reply_timeout, device.adapter.latency)
        self._late = LateReplies(self.clock)
        self._sent.clear()
        self._held = b""
        self._buffer.clear()
        self._echoes = None
        self._device, self._line = device, device.line

    def close(self) -> None:
        """Close the device; does nothing when it is closed or lost."""
        device, self._device = self._device, None
        self._line = None
        if device is not None:
            device.close()

    # Reading

    def read_group(self, group: ReadGroup, retries: int = 0) -> list[Reply | Retried | Failed]:
        """Read the same registers of several servos; return what became of each, in their order.

        Args:
            group: What to read.
            retries: How often a servo is asked again whose reply cannot be used.

        Raises:
            PortLostError: The device has gone.
        """
        line = self._line or self._open_line()
        try:
            if self._suspect_until or self._late.due or self._buffer:
                self._clear()
            else:
                line.discard_input()
            if group.method is not ReadMethod.EACH and len(group.ids) > 1:
                return self._read_together(group, retries)
            protocol, address, length = group.protocol, group.address, group.length
            plausible = group.plausible
            replies: list[Reply | Retried | Failed] = []
            for servo_id in group.ids:
                try:
                    reply = self._read(
                        protocol, servo_id, address, length, bool(self._suspect_until)
                    )
                except CommunicationError as cause:
                    replies.append(self._again(group, servo_id, retries, cause))
                    continue
                if plausible is None or plausible(reply.data):
                    replies.append(reply)
                else:
                    impossible = _impossible(servo_id, reply)
                    replies.append(self._again(group, servo_id, retries, impossible))
            return replies
        except _LOST as cause:
            raise self._lost(cause) from cause

    def _again(
        self, group: ReadGroup, servo_id: int, retries: int, cause: CommunicationError
    ) -> Retried | Failed:
        """Ask a servo once more, before anybody else is asked."""
        causes = [cause]
        while len(causes) <= retries:
            try:
                reply = self._read(group.protocol, servo_id, group.address, group.length)
            except CommunicationError as another:
                causes.append(another)
                continue
            if group.plausible is None or group.plausible(reply.data):
                return Retried(reply, tuple(causes))
            causes.append(_impossible(servo_id, reply))
        return Failed(tuple(causes))

    def read(self, servo_id: int, address: int, length: int, protocol: int = 1) -> Reply:
        """Read `length` bytes from `address` on.

        Raises:
            CommunicationError: No usable reply.
            PortLostError: The device has gone.
        """
        self._open_line()
        try:
            return self._read(protocol, servo_id, address, length)
        except _LOST as cause:
            raise self._lost(cause) from cause

    def _read(
        self, protocol: int, servo_id: int, address: int, length: int, clear: bool = True
    ) -> Reply:
        if self._late.due:
            return self._read_more(protocol, servo_id, address, length)
        request = _request(protocol, servo_id, address, length)
        if clear or self._buffer:
            self._clear()
        stamp = self._send(request)
        status = self._receive(protocol, servo_id, length)
        if status.error or len(status.data) != length:
            _check(protocol, status, length, f"read of {length} byte(s) at {address}")
        end = self._wire_free  # where bytes take no time, a reply may come before its time
        return Reply(status.data, status.error, stamp if stamp < end else end)

    def _read_more(self, protocol: int, servo_id: int, address: int, length: int) -> Reply:
        """Read some bytes more than needed, so that no late reply looks like this one."""
        extra = self._late.extra(protocol, (servo_id,), length)
        if extra is None:
            raise ReplyTimeoutError(f"servo {servo_id} has not answered many times")
        # Before what is needed, where there are as many: past the end there may be nothing.
        first = address - extra if address >= extra else address
        request = read_packet(protocol, servo_id, first, length + extra)
        self._clear()
        stamp = self._send(request)
        status = self._receive(protocol, servo_id, length + extra)
        _check(protocol, status, length + extra, f"read of {length + extra} byte(s) at {first}")
        data = status.data[address - first : address - first + length]
        return Reply(data, status.error, min(stamp, self._wire_free))

    def _read_together(self, group: ReadGroup, retries: int) -> list[Reply | Retried | Failed]:
        """Ask several servos with one packet, which they answer one after the other, or in one.

        Behind a silent one the others may wait for ever, so that they count as silent too. Who did
        not answer is asked alone once nobody speaks any more.
        """
        protocol, ids, fast = group.protocol, group.ids, group.method is ReadMethod.FAST_SYNC
        extra = self._extra(protocol, ids, group.length, fast)
        if extra is None:
            silent = ReplyTimeoutError("servos have not answered many times")
            return [Failed((silent,)) for _ in ids]
        address = group.address - extra if group.address >= extra else group.address
        length = group.length + extra
        if group.method is ReadMethod.BULK:
            request = bulk_read_packet(ids, address, length)
        else:
            request = _group_request(ids, address, length, fast=fast)
        stamp = self._send(request)
        outcomes: list[Status | CommunicationError] = []
        if fast:
            try:
                size = joint_status_size(len(ids), length)
                joint = self._receive(protocol, BROADCAST_ID, size)
                shares = split_joint_status(joint, length, len(ids))
                if tuple(share.id for share in shares) != ids:
                    raise CorruptReplyError(f"damaged reply to a fast sync read of {ids}")
                outcomes += shares
            except CommunicationError as cause:
                outcomes += [cause] * len(ids)
        else:
            for index, servo_id in enumerate(ids):
                try:
                    outcomes.append(self._receive(protocol, servo_id, length))
                except ReplyTimeoutError as cause:
                    outcomes += [cause] * (len(ids) - index)
                    for behind in ids[index + 1 :]:
                        self._late.add(protocol, behind, length, self._wire_free)
                    break
                except CorruptReplyError as cause:
                    outcomes.append(cause)
        offset = group.address - address
        replies: list[Reply | Retried | Failed] = []
        for servo_id, outcome in zip(ids, outcomes, strict=True):
            try:
                if isinstance(outcome, CommunicationError):
                    raise outcome
                if outcome.error or len(outcome.data) != length:
                    _check(protocol, outcome, length, f"read of {length} byte(s) at {address}")
                reply = Reply(
                    outcome.data[offset : offset + group.length] if extra else outcome.data,
                    outcome.error,
                    stamp,
                )
                if group.plausible is not None and not group.plausible(reply.data):
                    raise _impossible(servo_id, reply)
                replies.append(reply)
            except CommunicationError as cause:
                replies.append(self._again(group, servo_id, retries, cause))
        return replies

    def _extra(self, protocol: int, ids: Sequence[int], length: int, fast: bool) -> int | None:
        if not fast:
            return self._late.extra(protocol, ids, length)
        for extra in range(_MOST_EXTRA + 1):
            size = joint_status_size(len(ids), length + extra)
            if self._late.extra(2, (BROADCAST_ID,), size) == 0:
                return extra
        return None

    # Other instructions

    def ping(self, servo_id: int, protocol: int = 1) -> int:
        """Ask a servo whether it is there; return its error byte.

        Raises:
            CommunicationError: No usable reply.
            PortLostError: The device has gone.
        """
        self._open_line()
        packet = encode_packet(protocol, servo_id, Instruction.PING)
        length = _PING_LENGTHS[protocol]
        try:
            try:
                status = self._ask(protocol, servo_id, packet, length)
            except ReplyTimeoutError:
                # The honest reply to a ping of a servo with a voltage error looks like an echo.
                if not self._mirrored or protocol == 2:
                    raise
                if self._echoes is None:
                    self._echoes = self._line_echoes()
                if self._echoes:
                    raise
                status = Status(servo_id, packet[4])
        except _LOST as cause:
            raise self._lost(cause) from cause
        _check(protocol, status, length, "ping")
        return status.error

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
            CommunicationError: No usable reply.
            PortLostError: The device has gone.
        """
        packet = write_packet(protocol, servo_id, address, data)
        if not acknowledged:
            self._tell(packet)
            return 0
        return self._command(
            protocol, servo_id, packet, f"write of {len(data)} byte(s) at {address}"
        )

    def reboot(self, servo_id: int) -> None:
        """Restart a protocol 2.0 servo; it answers nothing for a while.

        Raises:
            CommunicationError: No usable reply.
            PortLostError: The device has gone.
        """
        self._command(2, servo_id, encode_packet(2, servo_id, Instruction.REBOOT), "reboot")

    def sync_write(self, address: int, data: Mapping[int, bytes], protocol: int = 1) -> None:
        """Write the same registers of several servos in one packet, by id; nobody answers.

        Raises:
            CommunicationError: The packet cannot be sent.
            PortLostError: The device has gone.
        """
        if data:
            self._tell(sync_write_packet(protocol, address, data))

    def find_all(self) -> dict[int, tuple[int, int]]:
        """Return Model Number and firmware of all protocol 2.0 servos, by id, with one packet.

        Raises:
            PortLostError: The device has gone.
        """
        line = self._open_line()
        found: dict[int, tuple[int, int]] = {}
        # Each servo waits until those with lower ids have had their time; dynamixel_sdk reckons so.
        seconds = 253 * (14 * self._seconds_per_byte + 0.003) + 0.016
        try:
            self._clear()
            self._send(encode_packet(2, BROADCAST_ID, Instruction.PING))
            deadline = self.clock() + seconds
            while data := line.read(_CHUNK, deadline):
                self._buffer += data
                while (status := self._next(2)[0]) is not None:
                    if len(status.data) == 3:
                        number = int.from_bytes(status.data[:2], "little")
                        found[status.id] = (number, status.data[2])
        except _LOST as cause:
            raise self._lost(cause) from cause
        return found

    # One request and its reply

    def _command(self, protocol: int, servo_id: int, packet: bytes, what: str) -> int:
        self._open_line()
        try:
            status = self._ask(protocol, servo_id, packet, 0)
        except _LOST as cause:
            raise self._lost(cause) from cause
        _check(protocol, status, 0, what)
        return status.error

    def _ask(self, protocol: int, servo_id: int, packet: bytes, length: int) -> Status:
        """Send a request and return what the servo replied."""
        self._clear()
        self._send(packet)
        return self._receive(protocol, servo_id, length)

    def _send(self, packet: bytes) -> float:
        """Write a packet; return when it will have gone over the wire, s."""
        line = self._line
        assert line is not None
        self._sent.append(packet)
        line.write(packet, self._write_timeout)
        free, now = self._wire_free, self.clock()
        free = (now if now > free else free) + len(packet) * self._seconds_per_byte
        self._wire_free = free
        return free

    def _receive(self, protocol: int, servo_id: int, length: int) -> Status:
        """Wait for the reply of a servo."""
        line = self._line
        assert line is not None
        size = OVERHEAD[protocol] + length
        due = self._wire_free + size * self._seconds_per_byte
        deadline = due + self._timeout.allowance
        self._mirrored = False
        if not self._buffer:
            data = line.read(_CHUNK, deadline)
            if len(data) == size and data not in self._sent:
                if protocol == 1:
                    if (
                        data[2] == servo_id
                        and data[3] == size - 4
                        and data[0] == 0xFF == data[1]
                        and data[4] <= 0x7F
                        and sum(data) & 0xFF == 0xFD  # FF twice, and what the checksum makes FF
                    ):
                        now = self._wire_free = self.clock()
                        self._timeout.learn(now - due)
                        return Status(servo_id, data[4], data[5:-1])
                elif (
                    data[4] == servo_id
                    and data[5] | data[6] << 8 == size - 7
                    and data[7] == STATUS
                    and data[:4] == HEADER[2]
                    and b"\xff\xff\xfd" not in data[8:]
                    and crc16(data[:-2]) == data[-2] | data[-1] << 8
                ):
                    now = self._wire_free = self.clock()
                    self._timeout.learn(now - due)
                    return Status(servo_id, data[8], data[9:-2])
            self._buffer += data
        return self._search(protocol, servo_id, length, due, deadline)

    def _search(
        self, protocol: int, servo_id: int, length: int, due: float, deadline: float
    ) -> Status:
        """Wait for the reply of a servo among echoes, noise, and packets that are not wanted."""
        line = self._line
        assert line is not None
        size = OVERHEAD[protocol] + length
        received = len(self._buffer)
        stray: Status | None = None
        was_damaged = False
        while True:
            status, damaged = self._next(protocol)
            was_damaged = was_damaged or damaged
            if status is not None:
                if status.id != servo_id:
                    self._note_surplus(status.id)
                    continue
                if len(status.data) != length and not _refuses(protocol, status):
                    late = self._late.take(protocol, servo_id, len(status.data))
                    if late is not None:
                        self._timeout.learn_late(late)
                    else:
                        self._note_surplus(servo_id)
                        stray = status
                    continue
                now = self.clock()
                self._timeout.learn(now - due)
                self._wire_free = now
                self._echoes = self._mirrored
                return status
            now = self.clock()
            if damaged and received >= size:  # that was it
                deadline = min(deadline, max(due, now) + _QUIET)
            elif self._buffer and deadline < now + _QUIET:
                deadline = min(now + _QUIET, due + _LONGEST)  # somebody is speaking
            data = line.read(_CHUNK, deadline)
            if not data:
                break
            received += len(data)
            self._buffer += data
        self._wire_free = self.clock()
        if stray is not None:
            return stray  # no reply to what was asked: the caller says so
        self._late.add(protocol, servo_id, length, due)
        if self._buffer_says_something() or was_damaged:
            raise CorruptReplyError(f"servo {servo_id}: damaged reply")
        what = _described(protocol, self._sent[-1])
        raise ReplyTimeoutError(
            f"servo {servo_id} did not answer a {what} within "
            f"{self._timeout.allowance * 1e3:.0f} ms on {self.name} at {self.baud_rate} baud"
        )

    def _next(self, protocol: int) -> tuple[Status | None, bool]:
        """Take the next status packet that is no echo out of the buffer.

        Returns:
            The packet, or None; and whether there was a damaged one.
        """
        while True:
            found = find_status(protocol, self._buffer)
            if found.status is None:
                return None, found.damaged
            before = bytes(self._buffer[: found.end - len(found.packet)])
            del self._buffer[: found.end]
            if any(sent in before for sent in self._sent):
                self._mirrored = True  # in protocol 2.0 an echo does not look like a status packet
            if found.packet not in self._sent:
                return found.status, found.damaged
            self._mirrored = True

    def _buffer_says_something(self) -> bool:
        """Whether more was received than the echo of what was sent."""
        rest = bytes(self._buffer)
        for packet in self._sent:
            if packet in rest:
                self._mirrored = True
                rest = rest.replace(packet, b"")
        return bool(rest)

    def _note_surplus(self, servo_id: int) -> None:
        self.surplus[servo_id] += 1
        self._suspect_until = self.clock() + _SUSPECT

    def _clear(self) -> None:
        """Forget what was received, and learn from replies that came too late."""
        line = self._line
        assert line is not None
        now = self.clock()
        if self._suspect_until:
            if now > self._suspect_until:
                self._suspect_until = 0.0
            else:  # wait until whoever sends too much has sent it
                extra = line.read(_CHUNK, now + 2.0 * _QUIET)
                while extra:
                    self._buffer += extra
                    extra = line.read(_CHUNK, self.clock() + 2.0 * _QUIET)
        if self._late.due:
            received = bytes(self._buffer) + line.read(_CHUNK, self.clock())
            for protocol in {protocol for protocol, _ in self._late.due}:
                self._buffer[:] = received
                while (status := self._next(protocol)[0]) is not None:
                    late = self._late.take(protocol, status.id, len(status.data))
                    if late is not None:
                        self._timeout.learn_late(late)
            self._late.forget()
        line.discard_input()
        self._buffer.clear()

    def _line_echoes(self) -> bool:
        """Find out whether the line echoes, with a byte that means nothing to any servo."""
        line = self._line
        assert line is not None
        self._clear()
        self._send(b"\x00")
        self._sent.pop()  # it would be found in every packet
        return line.read(_CHUNK, self._wire_free + self._timeout.allowance).startswith(b"\x00")

    def _tell(self, packet: bytes) -> None:
        if self._line is None:
            self._open_line()
        try:
            self._send(packet)
        except _LOST as cause:
            raise self._lost(cause) from cause

    def _open_line(self) -> Line:
        if self._line is None:
            raise NotConnectedError(f"{self.name} is not open; call open() first")
        return self._line

    def _lost(self, cause: Exception) -> PortLostError:
        self.close()
        return PortLostError(self.name, cause)


_request = lru_cache(maxsize=512)(read_packet)
_group_request = lru_cache(maxsize=128)(sync_read_packet)


def _described(protocol: int, request: bytes) -> str:
    """Return what a request asks for, in words."""
    code, start = (request[4], 5) if protocol == 1 else (request[7], 8)
    if code == Instruction.READ:
        address = int.from_bytes(request[start : start + protocol], "little")
        length = int.from_bytes(request[start + protocol : start + 2 * protocol], "little")
        return f"read of {length} byte(s) at {address}"
    try:
        return Instruction(code).name.lower().replace("_", " ")
    except ValueError:
        return f"packet with code {code}"


def _refuses(protocol: int, status: Status) -> bool:
    """Whether a servo says by a status without data why it does not do what was asked."""
    if status.data:
        return False
    return bool(status.error if protocol == 1 else status.error & ~ALERT)


def _check(protocol: int, status: Status, length: int, what: str) -> None:
    """Refuse the reply of a servo that received a damaged request, or of another length."""
    error = status.error
    if (error & ErrorBits.CHECKSUM) if protocol == 1 else error & ~ALERT == StatusCode.CRC:
        raise CorruptReplyError(f"servo {status.id} received a damaged {what}")
    if len(status.data) != length:
        told = describe_errors(ErrorBits(error)) if protocol == 1 else describe_status(error)
        raise CorruptReplyError(
            f"servo {status.id} answered a {what} with {len(status.data)} byte(s) of data; error "
            f"bits: {told}"
        )


def _impossible(servo_id: int, reply: Reply) -> CorruptReplyError:
    return CorruptReplyError(f"servo {servo_id}: impossible feedback {reply.data!r}")
