"""Timing of the half-duplex serial line between master and servos, with collisions.

Bytes that overlap are corrupted, but not those of equal packets that are sent at the same time, by
servos with the same id.
"""

from __future__ import annotations

import errno
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Final, TypeVar

from head_tracking.simulation.bus import Answer, SimulatedBus

_T = TypeVar("_T")
_GARBLED: Final = 0x55  # what is received instead of a byte that another one overlaps
_NOMINAL: Final = 10_000  # ns for a byte on a line without transmission times


class Overlap(Enum):
    """A collision of two senders."""

    REQUEST = "the master over a status packet"
    STATUS = "status packets of different requests"
    TWINS = "servos with the same id"
    FAULT = "a servo delayed by an injected fault, or an answer to a damaged packet"


@dataclass(slots=True, eq=False)
class _Transmission:
    """Bytes in transmission to the master."""

    start: int  # start of the first byte, ns
    data: bytearray  # as the master will receive them
    byte_time: int  # duration of one byte, ns
    late: int = 0  # additional delay of the adapter, ns
    fault: bool = False  # whether an injected fault caused or delayed them

    @property
    def end(self) -> int:
        """End of the last byte, ns."""
        return self.start + len(self.data) * self.byte_time

    def covered(self, start: int, end: int) -> range:
        """Return the indices of the bytes that overlap an interval."""
        first = max(0, (start - self.start) // self.byte_time)
        return range(first, min(len(self.data), -(-(end - self.start) // self.byte_time)))

    def absorb(self, other: _Transmission) -> bool:
        """Merge a later transmission into this one; return whether bytes were corrupted."""
        changed = (self.start, self.data) != (other.start, other.data)
        if changed:
            for number in self.covered(other.start, other.end):
                self.data[number] = _GARBLED
            first = (other.start - self.start) // self.byte_time
            self.data += other.data[len(self.data) - first :]
        self.late = max(self.late, other.late)
        self.fault |= other.fault
        return changed


class SerialLine:
    """Half-duplex line between master and servos. Not thread-safe; times are integer ns.

    Args:
        bus: The servos.
        paced: Whether bytes take the time of the baud rate. If not, answers arrive when the servo
            starts to send, and only servos with the same id can collide.
        latency: Latency timer of the adapter, s; 0: none. The default of FTDI chips is 16 ms.
        match_baud_rate: Whether only servos with the baud rate of the master receive it.

    Attributes:
        bus: The servos.
        overlaps: Number of collisions that corrupted bytes.
    """

    def __init__(
        self,
        bus: SimulatedBus,
        *,
        paced: bool = False,
        latency: float = 0.0,
        match_baud_rate: bool = False,
    ) -> None:
        self.bus = bus
        self.overlaps: Counter[Overlap] = Counter()
        self._paced, self._match = paced, match_baud_rate
        self._latency = round(latency * 1e9)
        self._sent = 0  # end of the last byte of the master
        self._pending: list[_Transmission] = []

    def send(self, data: bytes, now: int, baud_rate: int) -> None:
        """Send bytes of the master."""
        byte_time = 10_000_000_000 // baud_rate if self._paced else 0
        for sent in _pieces(data):
            start = max(now, self._sent)
            self._sent = start + len(sent) * byte_time
            alone = not byte_time or not self._pending
            heard = sent if alone else self._collide(sent, start, byte_time)
            answers = self.bus.receive(heard, self._sent, baud_rate if self._match else None)
            if answers:
                self._answer(answers, byte_time)

    def _collide(self, piece: bytes, start: int, byte_time: int) -> bytes:
        """Send while servos may be sending; return the bytes that the servos receive."""
        heard = _Transmission(start, bytearray(piece), byte_time)
        for status in self._pending:
            if status.start >= self._sent or status.end <= start:
                continue
            self.overlaps[Overlap.FAULT if status.fault else Overlap.REQUEST] += 1
            for spoken, other in ((heard, status), (status, heard)):
                for number in spoken.covered(other.start, other.end):
                    spoken.data[number] = _GARBLED
        return bytes(heard.data)

    def _answer(self, answers: list[Answer], byte_time: int) -> None:
        turn, turn_start, turn_end = 0, self._sent, self._sent
        mine: list[_Transmission] = []
        for answer in answers:
            if answer.echo:
                self._pending.append(_Transmission(self._sent, bytearray(answer.data), 0))
                continue
            if answer.turn != turn:
                turn, turn_start, mine = answer.turn, turn_end, []
            start = turn_start + answer.delay + answer.stalled
            fault = answer.stalled > 0 or answer.complaint
            data = bytearray(answer.data)
            spoken = _Transmission(start, data, byte_time or _NOMINAL, answer.late, fault)
            turn_end = max(turn_end, spoken.end if self._paced else start)
            for other in list(self._pending if self._paced else mine):
                if other.start < spoken.end and spoken.start < other.end:
                    spoken = self._merged(spoken, other, twins=other in mine)
                    self._pending.remove(other)
                    mine = [one for one in mine if one is not other]
            mine.append(spoken)
            self._pending.append(spoken)

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
        """Arrival time of the next bytes at the master, ns; None: nothing is pending."""
        return min(map(self._due, self._pending)) if self._pending else None

    def receive(self, now: int) -> bytes:
        """Return the bytes that have arrived at the master."""
        if not self._pending:
            return b""
        arrived = [spoken for spoken in self._pending if self._due(spoken) <= now]
        self._pending = [spoken for spoken in self._pending if spoken not in arrived]
        return b"".join(bytes(spoken.data) for spoken in sorted(arrived, key=self._due))

    def clear(self) -> None:
        """Discard pending bytes."""
        self._pending.clear()


def _pieces(data: bytes) -> Iterator[bytes]:
    """Split bytes at the ends of packets: each packet is received at its own time."""
    while data:
        length = len(data)
        if data[:4] == b"\xff\xff\xfd\x00" and len(data) > 6:
            length = (data[5] | data[6] << 8) + 7
        elif data[:2] == b"\xff\xff" and len(data) > 3:
            length = data[3] + 4
        yield data[:length]
        data = data[length:]


class SimulatedClock:
    """A clock that advances only while a caller waits.

    Attributes:
        now: ns.
    """

    def __init__(self, now: int = 0) -> None:
        self.now = now

    def __call__(self) -> float:
        """Return the time, s."""
        return self.now * 1e-9

    def pass_until(self, when: int) -> None:
        """Advance to a time, ns, unless it is in the past."""
        self.now = max(self.now, when)


class SteadyClock:
    """The steady clock of this machine, in place of a `SimulatedClock`."""

    @property
    def now(self) -> int:
        """The time, ns."""
        return time.monotonic_ns()

    def pass_until(self, when: int) -> None:
        """Wait until a time, ns."""
        while (left := when - self.now) > 0:
            time.sleep(left * 1e-9)


class SimulatedLine(SerialLine):
    """A serial device in this process; in simulated time waiting advances the clock.

    Args:
        bus: The servos.
        clock: The time.
        baud_rate: Bits per second.
        paced: See `SerialLine`; also for the other arguments.

    Attributes:
        plugged: False: all methods raise OSError, as for a removed device.
    """

    def __init__(
        self,
        bus: SimulatedBus,
        clock: SimulatedClock | SteadyClock,
        baud_rate: int = 1_000_000,
        *,
        paced: bool = True,
        latency: float = 0.0,
        match_baud_rate: bool = False,
    ) -> None:
        self.plugged = True
        super().__init__(bus, paced=paced, latency=latency, match_baud_rate=match_baud_rate)
        self._clock, self._baud_rate = clock, baud_rate
        self._received = b""
        self._lock = threading.Lock()

    def discard_input(self) -> None:
        """Discard received bytes."""
        self._check()
        self.receive(self._clock.now)
        self._received = b""

    def write(self, data: bytes) -> None:
        """Write all bytes, without waiting."""
        self._check()
        with self._lock:
            self.send(data, self._clock.now, self._baud_rate)

    def read(self, limit: int, deadline: float) -> bytes:
        """Return at most `limit` bytes; wait for the first one until the deadline, s."""
        self._check()
        if not self._received:
            due, end = self.due, round(deadline * 1e9)
            self._clock.pass_until(end if due is None else min(due, end))
            self._received = self.receive(self._clock.now)
        data, self._received = self._received[:limit], self._received[limit:]
        return data

    def use(self, function: Callable[[SimulatedBus], _T]) -> _T:
        """Call a function with the bus, simulated up to the present; for any thread."""
        with self._lock:
            self.bus.advance(self._clock.now)
            return function(self.bus)

    def close(self) -> None:
        """Do nothing."""

    def _check(self) -> None:
        if not self.plugged:
            raise OSError(errno.EIO, "the device is gone")
