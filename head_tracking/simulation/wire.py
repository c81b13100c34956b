"""When bytes arrive: the time they take on the wire, and the adapter's habit of keeping them."""

from __future__ import annotations

import heapq

from head_tracking.simulation.bus import SimulatedBus


class Wire:
    """The way from the master to the servos and back. Not thread-safe; times are integer ns.

    Args:
        bus: The servos.
        paced: Whether bytes take the time that they take at the baud rate.
        latency: Period at which the adapter hands on what it received, ns; 0: at once. FTDI chips
            have 16 ms from the factory.
        match_baud_rate: Whether only servos that are set to the master's baud rate hear it.
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
        self._paced = paced
        self._latency = latency
        self._match = match_baud_rate
        self._heard = 0
        self._free = 0
        self._coming: list[tuple[int, int, bytes]] = []
        self._count = 0

    def send(self, data: bytes, now: int, baud_rate: int) -> None:
        """Take bytes from the master."""
        byte_time = 10_000_000_000 // baud_rate if self._paced else 0
        self._heard = max(now, self._heard) + len(data) * byte_time
        heard = self._heard
        for answer in self.bus.receive(data, heard, baud_rate if self._match else None):
            start = (max(heard, self._free) if answer.follows else heard) + answer.delay
            end = max(start, self._free) + len(answer.data) * byte_time
            self._free = end
            due = end + answer.late
            if self._latency:
                due = -(-due // self._latency) * self._latency
            self._count += 1
            heapq.heappush(self._coming, (due, self._count, answer.data))

    @property
    def due(self) -> int | None:
        """When the next bytes arrive at the master, ns; None if none are under way."""
        return self._coming[0][0] if self._coming else None

    def take(self, now: int) -> bytes:
        """Return what has arrived at the master."""
        data = b""
        while self._coming and self._coming[0][0] <= now:
            data += heapq.heappop(self._coming)[2]
        return data

    def clear(self) -> None:
        """Forget what is under way."""
        self._coming.clear()
