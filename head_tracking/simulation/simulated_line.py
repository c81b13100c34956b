"""A simulated bus without a port and without waiting: for tests in simulated time."""

from __future__ import annotations

import errno

from head_tracking.simulation.bus import SimulatedBus
from head_tracking.simulation.wire import Wire


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
    """Bytes in and out of a simulated bus, in simulated time: a stand-in for an open serial device.

    Args:
        bus: The servos.
        clock: Waiting for an answer lets its time pass.
        baud_rate: Bits per second.
        paced: Whether bytes take their time on the wire.
        latency: Period at which the adapter hands on what it received, s; 0: at once.
        match_baud_rate: Whether only servos that are set to the baud rate hear it.

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
        self._wire = Wire(
            bus, paced=paced, latency=round(latency * 1e9), match_baud_rate=match_baud_rate
        )
        self._clock = clock
        self._baud_rate = baud_rate
        self._received = b""

    def discard_input(self) -> None:
        """Forget everything received so far."""
        self._check()
        self._wire.take(self._clock.now)
        self._received = b""

    def write(self, data: bytes, timeout: float = 0.0) -> None:
        """Write all bytes; takes no time. `timeout` is not needed."""
        self._check()
        self._wire.send(data, self._clock.now, self._baud_rate)

    def read(self, limit: int, deadline: float) -> bytes:
        """Return at most `limit` bytes, waiting for the first one until the deadline, s."""
        self._check()
        if not self._received:
            due = self._wire.due
            self._clock.pass_until(deadline if due is None else min(deadline, due * 1e-9))
            if due is not None and due * 1e-9 <= deadline:
                self._clock.now = max(self._clock.now, due)
            self._received = self._wire.take(self._clock.now)
        data, self._received = self._received[:limit], self._received[limit:]
        return data

    def _check(self) -> None:
        if not self.plugged:
            raise OSError(errno.EIO, "the device has gone")
