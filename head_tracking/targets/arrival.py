"""Whether a head that somebody else turns has got to where it was sent."""

from __future__ import annotations


class Arrival:
    """Arrived is who misses by little and goes on doing so. Times are in seconds, on any clock.

    Args:
        tolerance: the largest miss that counts as arrived [rad].
        settle_time: how long the miss has to stay below it [s].
    """

    def __init__(self, tolerance: float, settle_time: float) -> None:
        self._tolerance = tolerance
        self._settle_time = settle_time
        self._since: float | None = None

    def step(self, miss: float, now: float) -> bool:
        """Takes the miss of now [rad]; whether the head has arrived."""
        if miss > self._tolerance:
            self._since = None
            return False
        if self._since is None:
            self._since = now
        return now - self._since >= self._settle_time
