"""The serial line between master and servos, in time: one wire, on which one can speak at a time.

Bytes that overlap garble each other. Servos with the same id that send the same bytes at the same
time are understood all the same; other bytes at the same time pull the wire low together; and bytes
that overlap by a part are heard as something else altogether.
"""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from typing import Final

from head_tracking.simulation.bus import Answer, SimulatedBus

_GARBLED: Final = 0x55  # bits by which a byte that is overlapped by a part is heard differently
_NOMINAL: Final = 10_000  # ns for a byte where bytes take no time


class Overlap(Enum):
    """Two speakers at the same time."""

    REQUEST = "the master over a status packet"
    STATUS = "status packets of different requests"
    TWINS = "servos with the same id"
    FAULT = "a servo that a fault made late, or answer what it misheard, over anything"


class _Transmission:
    """Bytes on the wire, or of the adapter, on their way to the master.

    Attributes:
        start: When the first byte begins, ns.
        data: The bytes, as the master will hear them.
        byte_time: Time of one, ns.
        late: Time by which the adapter hands them on late, ns.
        fault: Whether a fault made the servo send them, or send them late.
    """

    def __init__(
        self, start: int, data: bytes, byte_time: int, late: int = 0, fault: bool = False
    ) -> None:
        self.start, self.data, self.byte_time = start, bytearray(data), byte_time
        self.late, self.fault = late, fault

    @property
    def end(self) -> int:
        """When the last byte ends, ns."""
        return self.start + len(self.data) * self.byte_time

    def covered(self, start: int, end: int) -> range:
        """Return the numbers of its bytes that share a moment with a span of time."""
        first = max(0, (start - self.start) // self.byte_time)
        return range(first, min(len(self.data), -(-(end - self.start) // self.byte_time)))

    def absorb(self, other: _Transmission) -> bool:
        """Hear one that begins later at the same time; return whether it mattered."""
        offset = other.start - self.start
        first = offset // self.byte_time
        changed = False
        if offset % self.byte_time:
            for number in self.covered(other.start, other.end):
                self.data[number] ^= _GARBLED
            self.data += other.data[len(self.data) - first :]
            changed = True
        else:
            for number, byte in enumerate(other.data, first):
                if number < len(self.data):
                    changed |= self.data[number] != byte
                    self.data[number] &= byte
                else:
                    self.data.append(byte)
        self.late = max(self.late, other.late)
        self.fault |= other.fault
        return changed


class SerialLine:
    """The way from the master to the servos and back. Not thread-safe; times are integer ns.

    Args:
        bus: The servos.
        paced: Whether bytes take the time that they take at the baud rate. If not, answers are
            there as soon as the servo begins, and only servos with the same id can overlap.
        latency: Period at which the adapter hands on what it received, ns; 0: at once. FTDI chips
            have 16 ms from the factory.
        match_baud_rate: Whether only servos that are set to the master's baud rate hear it.

    Attributes:
        bus: The servos.
        overlaps: How often two spoke at the same time, so that something was garbled.
    """

    def __init__(
        self,
        bus: SimulatedBus,
        *,
        paced: bool = False,
        latency: int = 0,
        match_baud_rate: bool = False,
    ) -> None:
        self.bus = bus
        self.overlaps: Counter[Overlap] = Counter()
        self._paced, self._latency, self._match = paced, latency, match_baud_rate
        self._sent = 0  # when the master's last byte ends
        self._coming: list[_Transmission] = []

    def send(self, data: bytes, now: int, baud_rate: int) -> None:
        """Take bytes from the master."""
        byte_time = 10_000_000_000 // baud_rate if self._paced else 0
        for sent in _pieces(data):
            start = max(now, self._sent)
            self._sent = start + len(sent) * byte_time
            alone = not byte_time or not self._coming
            heard = sent if alone else self._speak_over(sent, start, byte_time)
            answers = self.bus.receive(heard, self._sent, baud_rate if self._match else None)
            if answers:
                self._answer(answers, byte_time)

    def _speak_over(self, piece: bytes, start: int, byte_time: int) -> bytes:
        """Let the master talk while others may; return what servos hear."""
        heard = _Transmission(start, piece, byte_time)
        for status in self._coming:
            if status.start >= self._sent or status.end <= start:
                continue
            self.overlaps[Overlap.FAULT if status.fault else Overlap.REQUEST] += 1
            for spoken, other in ((heard, status), (status, heard)):
                for number in spoken.covered(other.start, other.end):
                    spoken.data[number] ^= _GARBLED
        return bytes(heard.data)

    def _answer(self, answers: list[Answer], byte_time: int) -> None:
        """Put the answers to one piece on the wire."""
        turn, turn_start, turn_end = 0, self._sent, self._sent
        mine: list[_Transmission] = []
        for answer in answers:
            if answer.echo:
                self._coming.append(_Transmission(self._sent, answer.data, 0))
                continue
            if answer.turn != turn:
                turn, turn_start = answer.turn, turn_end
            start = turn_start + answer.delay + answer.stalled
            fault = answer.stalled > 0 or answer.complaint
            spoken = _Transmission(start, answer.data, byte_time or _NOMINAL, answer.late, fault)
            turn_end = max(turn_end, spoken.end if self._paced else start)
            for other in list(self._coming if self._paced else mine):
                if other.start < spoken.end and spoken.start < other.end:
                    spoken = self._merged(spoken, other, twins=other in mine)
                    self._coming.remove(other)
                    mine = [one for one in mine if one is not other]
            mine.append(spoken)
            self._coming.append(spoken)

    def _merged(self, one: _Transmission, other: _Transmission, *, twins: bool) -> _Transmission:
        first, second = sorted((one, other), key=lambda spoken: spoken.start)
        kind = Overlap.TWINS if twins else Overlap.STATUS
        kind = Overlap.FAULT if one.fault or other.fault else kind
        if first.absorb(second):
            self.overlaps[kind] += 1
        return first

    def _due(self, spoken: _Transmission) -> int:
        time = (spoken.end if self._paced else spoken.start) + spoken.late
        return -(-time // self._latency) * self._latency if self._latency else time

    @property
    def due(self) -> int | None:
        """When the next bytes arrive at the master, ns; None if none are under way."""
        return min(map(self._due, self._coming)) if self._coming else None

    def take(self, now: int) -> bytes:
        """Return what has arrived at the master."""
        if not self._coming:
            return b""
        arrived = [spoken for spoken in self._coming if self._due(spoken) <= now]
        self._coming = [spoken for spoken in self._coming if spoken not in arrived]
        return b"".join(bytes(spoken.data) for spoken in sorted(arrived, key=self._due))

    def clear(self) -> None:
        """Forget what is under way."""
        self._coming.clear()


def _pieces(data: bytes) -> Iterator[bytes]:
    """Cut what was sent at once where packets seem to end: each is heard at its own time."""
    while data:
        length = len(data)
        if data[:4] == b"\xff\xff\xfd\x00" and len(data) > 6:
            length = (data[5] | data[6] << 8) + 7
        elif data[:2] == b"\xff\xff" and len(data) > 3:
            length = data[3] + 4
        yield data[:length]
        data = data[length:]


class SimulatedClock:
    """Time that passes only when somebody waits.

    Attributes:
        now: ns.
    """

    def __init__(self, now: int = 0) -> None:
        self.now = now

    def __call__(self) -> float:
        """Return the time, s."""
        return self.now * 1e-9

    def pass_until(self, time: float) -> None:
        """Let time pass up to `time`, s; does nothing if that has been."""
        self.now = max(self.now, round(time * 1e9))


class SimulatedLine:
    """A serial line in simulated time: a stand-in for an open serial device, without waiting.

    Args:
        bus: The servos.
        clock: Waiting for an answer lets its time pass.
        baud_rate: Bits per second.
        paced: See `SerialLine`.
        latency: Period at which the adapter hands on what it received, s; 0: at once.
        match_baud_rate: See `SerialLine`.

    Attributes:
        plugged: While it is false, all methods raise OSError, as of a device that has gone.
    """

    def __init__(
        self,
        bus: SimulatedBus,
        clock: SimulatedClock,
        baud_rate: int = 1_000_000,
        *,
        paced: bool = True,
        latency: float = 0.0,
        match_baud_rate: bool = False,
    ) -> None:
        self.plugged = True
        self._line = SerialLine(
            bus, paced=paced, latency=round(latency * 1e9), match_baud_rate=match_baud_rate
        )
        self._clock, self._baud_rate = clock, baud_rate
        self._received = b""

    @property
    def overlaps(self) -> Counter[Overlap]:
        """How often two spoke at the same time."""
        return self._line.overlaps

    def discard_input(self) -> None:
        """Forget everything received so far."""
        self._check()
        self._line.take(self._clock.now)
        self._received = b""

    def write(self, data: bytes, timeout: float = 0.0) -> None:
        """Write all bytes; takes no time. `timeout` is not needed."""
        self._check()
        self._line.send(data, self._clock.now, self._baud_rate)

    def read(self, limit: int, deadline: float) -> bytes:
        """Return at most `limit` bytes, waiting for the first one until the deadline, s."""
        self._check()
        if not self._received:
            due = self._line.due
            self._clock.pass_until(deadline if due is None else min(deadline, due * 1e-9))
            if due is not None and due * 1e-9 <= deadline:
                self._clock.now = max(self._clock.now, due)
            self._received = self._line.take(self._clock.now)
        data, self._received = self._received[:limit], self._received[limit:]
        return data

    def _check(self) -> None:
        if not self.plugged:
            raise OSError(errno.EIO, "the device has gone")
