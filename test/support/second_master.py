"""A second program on the line, which polls a servo whatever others do; simulated time."""

from __future__ import annotations

from head_tracking.simulation import SimulatedClock, SimulatedLine

_BYTE = 10_000  # ns at 1 Mbaud
_REQUEST = bytes.fromhex("FF FF 01 04 02 24 02 D2")
_REPLY = bytes.fromhex("FF FF 01 04 00 00 02 F8")
_RETURN_DELAY = 100_000  # ns


class SecondMaster:
    """Stands between a line and the driver. What overlaps with a foreign packet is lost.

    Args:
        line: The line.
        clock: Its clock.
        gap: From the end of a reply to the next request, s.

    Attributes:
        speaks: Whether the second master is there.
        spoken_over: How often the driver spoke over it.
        heard: Packets of the driver that reached the servos.
    """

    def __init__(self, line: SimulatedLine, clock: SimulatedClock, gap: float) -> None:
        self.speaks = True
        self.spoken_over = 0
        self.heard: list[bytes] = []
        self._line, self._clock = line, clock
        self._first = clock.now
        request, reply = len(_REQUEST) * _BYTE, len(_REPLY) * _BYTE
        self._spoken = ((0, request), (request + _RETURN_DELAY, request + _RETURN_DELAY + reply))
        self._period = self._spoken[1][1] + round(gap * 1e9)
        self._taken = clock.now  # until when its packets have been handed over

    def _ends(self, since: int) -> tuple[int, bytes]:
        """Return when the next foreign packet after a time ends, and the packet."""
        turn = (since - self._first) // self._period
        while True:
            for (_, end), packet in zip(self._spoken, (_REQUEST, _REPLY), strict=True):
                time = self._first + turn * self._period + end
                if time > since:
                    return time, packet
            turn += 1

    def discard_input(self) -> None:
        self._line.discard_input()
        self._taken = max(self._taken, self._clock.now)

    def write(self, data: bytes, timeout: float = 0.0) -> None:
        begin, end = self._clock.now, self._clock.now + len(data) * _BYTE
        turn = (begin - self._first) // self._period
        for start, stop in (
            (self._first + n * self._period + start, self._first + n * self._period + stop)
            for n in range(turn, turn + 3)
            for start, stop in self._spoken
        ):
            if self.speaks and start < end and begin < stop:
                self.spoken_over += 1
                return
        self.heard.append(data)
        self._line.write(data, timeout)

    def read(self, limit: int, deadline: float) -> bytes:
        assert self._clock.now < self._first + 60_000_000_000, "waits for ever"
        if not self.speaks:
            return self._line.read(limit, deadline)
        end, packet = self._ends(self._taken)
        if own := self._line.read(limit, min(deadline, end * 1e-9)):
            return own
        if end > round(deadline * 1e9):
            return b""
        self._clock.now = max(self._clock.now, end)
        data = b""
        while end <= self._clock.now:  # all that has arrived comes at once
            data, self._taken = data + packet, end
            end, packet = self._ends(end)
        return data
