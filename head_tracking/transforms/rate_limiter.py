"""Limits the rate of messages by their stamps."""

from __future__ import annotations

DISORDER = 1_000_000_000
"""When stamps go back by more than this [ns], the clock has jumped back."""


class RateLimiter:
    """Accepts messages at a mean rate of at most `frequency` [Hz].

    Messages are due on a grid, and accepted up to half a period early. So all messages of a stream
    of just this frequency are accepted. When the clock jumps back, the grid begins anew.

    Args:
        frequency: messages per second.
        ignore_timestamp: accept messages also if their stamps go back.
    """

    def __init__(self, frequency: float, *, ignore_timestamp: bool = False) -> None:
        self._period = round(1e9 / frequency)
        self._ignore_timestamp = ignore_timestamp
        self._last: int | None = None
        self._due = 0

    def accept(self, stamp: int) -> bool:
        """Return whether the message with this stamp [ns] is accepted."""
        last = self._last
        if last is not None and stamp <= last:
            if not self._ignore_timestamp and stamp > last - DISORDER:
                return False
            self._due = stamp
        elif last is None or stamp - self._due > self._period:
            self._due = stamp
        if stamp < self._due - self._period // 2:
            return False
        self._due += self._period
        self._last = stamp
        return True
