"""Letting through no more than so many messages a second."""

from __future__ import annotations

DISORDER = 1_000_000_000
"""Stamps that go back farther than this [ns] are those of a clock that jumped back."""


class RateLimiter:
    """Picks messages by their stamps, at a mean rate of at most `frequency` [Hz].

    robot_state_publisher drops every second message of a stream at just its own frequency,
    because half of them come a little early. Here messages are due on a grid, and one that comes
    up to half a period early is the one that was due. A clock that jumps back begins anew.

    Args:
        frequency: messages per second.
        ignore_timestamp: let messages through also if their stamps go back.
    """

    def __init__(self, frequency: float, *, ignore_timestamp: bool = False) -> None:
        self._period = round(1e9 / frequency)
        self._ignore_timestamp = ignore_timestamp
        self._last: int | None = None
        self._due = 0

    def accept(self, stamp: int) -> bool:
        """Whether the message of this time [ns] is let through."""
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
