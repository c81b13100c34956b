"""Questions and answers on a line where only one may speak at a time."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from head_tracking.dynamixel.answer import Answer, Failure, Window
from head_tracking.dynamixel.debts import Debts
from head_tracking.dynamixel.line import Line
from head_tracking.dynamixel.patience import Patience
from head_tracking.dynamixel.port import ReadMethod
from head_tracking.dynamixel.protocol import (
    BROADCAST_ID,
    OVERHEAD,
    Instruction,
    Status,
    bulk_read_packet,
    encode_packet,
    find_status,
    joint_status_size,
    read_packet,
    split_joint_status,
    sync_read_packet,
)

_CHUNK: Final = 4096
_REMAINDER: Final = 0.0005  # s that are listened on after a damaged answer
_FAST_TRIES: Final = 25
PING_LENGTHS: Final = {1: 0, 2: 3}
"""Bytes of data in the answer to a ping, by protocol."""


class Conversation:
    """Asks servos and makes sure that an answer answers the question.

    An answer that comes too late may look just like the answer to the next question. So a servo
    that owes one is asked for some bytes more than needed, and answers of the old length are known
    for what they are.

    What is received and equals what was sent is the echo of an adapter that joins both directions,
    and no answer. The one honest answer that can look so, a ping's of a servo with a voltage error,
    counts if the line has shown that it does not echo.

    Args:
        line: The open line.
        baud_rate: Bits per second.
        patience: How long an answer may take besides the time on the wire.
        write_timeout: How long the device may refuse data, s.
        clock: Monotonic time, s.

    All methods raise OSError or termios.error when the device has gone.
    """

    def __init__(
        self,
        line: Line,
        baud_rate: int,
        patience: Patience,
        write_timeout: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._line = line
        self._seconds_per_byte = 10.0 / baud_rate
        self._patience = patience
        self._write_timeout = write_timeout
        self._clock = clock
        self._debts = Debts(clock)
        self._buffer = bytearray()
        self._sent: deque[bytes] = deque(maxlen=4)
        self._held = b""
        self._wire_free = 0.0
        self._quiet = False  # the last answer left nothing over
        self._echoes: bool | None = None
        self._mirrored = False  # the last question came back

    def hold(self, packet: bytes) -> None:
        """Send a packet that nobody answers together with the next question, or by `flush`."""
        self._sent.append(packet)
        self._held += packet

    def flush(self) -> None:
        """Send what is held."""
        held, self._held = self._held, b""
        if held:
            self._write(held)

    def ask(self, protocol: int, servo_id: int, packet: bytes, length: int) -> Answer:
        """Send a packet and return what a servo answers.

        Args:
            protocol: 1 or 2.
            servo_id: The servo.
            packet: The instruction.
            length: Bytes of data that its answer should have.
        """
        self._begin(packet)
        return self._listen(protocol, servo_id, length)

    def ping(self, protocol: int, servo_id: int) -> Answer:
        """Ask a servo whether it is there."""
        packet = encode_packet(protocol, servo_id, Instruction.PING)
        answer = self.ask(protocol, servo_id, packet, PING_LENGTHS[protocol])
        if answer is Failure.SILENT and self._mirrored and protocol == 1:
            if self._echoes is None:
                self._echoes = self._line_echoes()
            if not self._echoes:
                return Status(servo_id, packet[4], b"")
        return answer

    def read(self, protocol: int, servo_id: int, address: int, length: int) -> Answer:
        """Ask a servo for `length` bytes from `address` on."""
        extra = self._debts.extra(protocol, (servo_id,), length)
        if extra is None:
            return Failure.SILENT
        window = Window(address, length, extra)
        packet = read_packet(protocol, servo_id, window.start, window.size)
        return window.part(self.ask(protocol, servo_id, packet, window.size))

    def read_each(
        self, protocol: int, ids: Sequence[int], address: int, length: int
    ) -> Iterator[Answer]:
        """Ask servos in turn; the next question goes out before an answer is handed out.

        The first one has gone out when this returns. After a failure none is under way, so that
        the same servo may be asked again before the next.
        """
        asked = not self._debts
        if asked:
            self._begin(read_packet(protocol, ids[0], address, length))
        return self._each(protocol, ids, address, length, asked)

    def _each(
        self, protocol: int, ids: Sequence[int], address: int, length: int, asked: bool
    ) -> Iterator[Answer]:
        last = len(ids) - 1
        heard = -1
        try:
            for index, servo_id in enumerate(ids):
                if not asked:
                    yield self.read(protocol, servo_id, address, length)
                    continue
                following = b""
                if index < last:
                    following = read_packet(protocol, ids[index + 1], address, length)
                answer = self._listen(protocol, servo_id, length, following)
                heard = index
                asked = type(answer) is Status
                yield answer
        finally:
            if asked and heard < last:
                self._debts.add(protocol, ids[heard + 1], length, self._clock())

    def read_together(
        self, method: ReadMethod, ids: tuple[int, ...], address: int, length: int
    ) -> Iterator[Answer]:
        """Ask several servos with one packet, which they answer one after the other, or in one.

        Behind a silent one the others may wait for ever, so they count as silent too. The packet
        has gone out when this returns.
        """
        protocol = 1 if method is ReadMethod.BULK else 2
        if method is ReadMethod.FAST_SYNC:
            extra = self._fast_extra(len(ids), length)
        else:
            extra = self._debts.extra(protocol, ids, length)
        if extra is None:
            return iter([Failure.SILENT] * len(ids))
        window = Window(address, length, extra)
        if method is ReadMethod.BULK:
            request = bulk_read_packet(ids, window.start, window.size)
        else:
            fast = method is ReadMethod.FAST_SYNC
            request = sync_read_packet(ids, window.start, window.size, fast=fast)
        self._begin(request)
        if method is ReadMethod.FAST_SYNC:
            answers = self._fast(ids, window.size)
        else:
            answers = self._together(protocol, ids, window.size)
        return map(window.part, answers)

    def _together(self, protocol: int, ids: Sequence[int], length: int) -> Iterator[Answer]:
        heard = 0
        try:
            for servo_id in ids:
                answer = self._listen(protocol, servo_id, length)
                heard += 1
                yield answer
                if answer is Failure.SILENT:
                    break
        finally:
            for servo_id in ids[heard:]:
                self._debts.add(protocol, servo_id, length, self._clock())
        yield from [Failure.SILENT] * (len(ids) - heard)

    def _fast(self, ids: tuple[int, ...], length: int) -> Iterator[Answer]:
        answer = self._listen(2, BROADCAST_ID, joint_status_size(len(ids), length))
        if not isinstance(answer, Status):
            yield from [answer] * len(ids)
            return
        shares = split_joint_status(answer, length, len(ids))
        if tuple(share.id for share in shares) == ids:
            yield from shares
        else:
            yield from [Failure.DAMAGED] * len(ids)

    def _fast_extra(self, count: int, length: int) -> int | None:
        """Return how many bytes more to ask for, as `Debts.extra` does."""
        for extra in range(_FAST_TRIES):
            if self._debts.extra(2, (BROADCAST_ID,), joint_status_size(count, length + extra)) == 0:
                return extra
        return None

    def collect(self, protocol: int, packet: bytes, seconds: float) -> list[Status]:
        """Send a packet and return all answers of that time, s."""
        self._begin(packet)
        found: list[Status] = []
        deadline = self._clock() + seconds
        while data := self._line.read(_CHUNK, deadline):
            self._buffer += data
            while (status := self._next(protocol)[0]) is not None:
                found.append(status)
        return found

    def _begin(self, packet: bytes) -> None:
        """Send the first question after a pause."""
        if not self._quiet:
            if self._debts:
                self._take_late_answers()
            self._line.discard_input()
            self._buffer.clear()
        self._quiet = False
        self._tell(packet)

    def _take_late_answers(self) -> None:
        """Learn from answers that came while nobody waited for them."""
        now = self._clock()
        received = bytes(self._buffer) + self._line.read(_CHUNK, now)
        for protocol in self._debts.protocols:
            self._buffer[:] = received
            while (status := self._next(protocol)[0]) is not None:
                late = self._debts.pay(protocol, status.id, len(status.data))
                if late is not None:
                    self._patience.learn(late)
        self._debts.forget()

    def _tell(self, packet: bytes) -> None:
        """Send a question, behind what is held."""
        self._sent.append(packet)
        held = self._held
        if held:
            self._held = b""
            packet = held + packet
        self._write(packet)

    def _write(self, data: bytes) -> None:
        self._line.write(data, self._write_timeout)
        now = self._clock()
        if now < self._wire_free:
            now = self._wire_free
        self._wire_free = now + len(data) * self._seconds_per_byte

    def _listen(self, protocol: int, servo_id: int, length: int, following: bytes = b"") -> Answer:
        """Wait for the answer of a servo, then send the following question, if both are there."""
        size = OVERHEAD[protocol] + length
        due = self._wire_free + size * self._seconds_per_byte
        deadline = due + self._patience.allowance
        self._mirrored = self._quiet = False
        if not self._buffer and not self._debts:
            data = self._line.read(_CHUNK, deadline)
            if len(data) == size:
                found = find_status(protocol, data)
                status = found.status
                if (
                    status is not None
                    and status.id == servo_id
                    and found.end == size
                    and data not in self._sent
                ):
                    now = self._wire_free = self._clock()
                    if following:
                        self._tell(following)
                    self._patience.learn(now - due)
                    self._echoes = False
                    self._quiet = not following
                    return status
            self._buffer += data
        answer = self._search(protocol, servo_id, length, due, deadline)
        if following and type(answer) is Status:
            self._tell(following)
        return answer

    def _search(
        self, protocol: int, servo_id: int, length: int, due: float, deadline: float
    ) -> Answer:
        """Wait for the answer of a servo among echoes, noise, and answers that are not wanted."""
        spoilt = False
        while True:
            status, damaged = self._next(protocol)
            if status is not None:
                if status.id != servo_id:
                    continue
                if self._debts and len(status.data) != length:
                    late = self._debts.pay(protocol, servo_id, len(status.data))
                    if late is not None:
                        self._patience.learn(late)
                        continue
                now = self._clock()
                self._patience.learn(now - due)
                self._wire_free = now
                self._echoes = self._mirrored
                return status
            if damaged and not spoilt:
                spoilt = True
                deadline = min(deadline, max(due, self._clock()) + _REMAINDER)
            data = self._line.read(_CHUNK, deadline)
            if not data:
                break
            self._buffer += data
        self._debts.add(protocol, servo_id, length, due)
        return Failure.DAMAGED if self._buffer else Failure.SILENT

    def _next(self, protocol: int) -> tuple[Status | None, bool]:
        """Take the next status packet that is no echo out of the buffer.

        Returns:
            The packet, or None; and whether there was a damaged one.
        """
        while True:
            found = find_status(protocol, self._buffer)
            if found.status is None:
                return None, found.damaged
            del self._buffer[: found.end]
            if found.packet not in self._sent:
                return found.status, found.damaged
            self._mirrored = True

    def _line_echoes(self) -> bool:
        """Find out whether the line echoes, with a byte that means nothing to any servo."""
        self._begin(b"\x00")
        deadline = self._wire_free + self._patience.allowance
        return self._line.read(_CHUNK, deadline).startswith(b"\x00")
