"""The definition of "arrived", for joints and for the pointing axis."""

from __future__ import annotations

from collections.abc import Sequence

AT_GOAL = 0.03
"""Largest error of a joint that is at its goal [rad], with dead band, play and sag."""

LONGEST_GAP = 0.1
"""What the time between two measurements counts at most [s] where a joint is judged to stand.

In a longer gap the program may have stood still itself, and sent no command.
"""


def at_goal(positions: Sequence[float], goals: Sequence[float]) -> bool:
    """Return whether every joint is at its goal [rad]."""
    return all(abs(a - b) < AT_GOAL for a, b in zip(positions, goals, strict=True))


class Arrival:
    """Detect that an error stays small. Times are in seconds, on any clock.

    Between two steps at most `LONGEST_GAP` counts.

    Args:
        tolerance: the largest error that counts as small [rad].
        settle_time: how long the error has to stay below it [s].
    """

    def __init__(self, tolerance: float, settle_time: float) -> None:
        self._tolerance = tolerance
        self._settle_time = settle_time
        self._since: float | None = None
        self._last = 0.0

    def step(self, error: float, now: float) -> bool:
        """Accept the present error [rad] and return whether it has stayed small."""
        if error > self._tolerance:
            self._since = None
            return False
        if self._since is None:
            self._since = self._last = now
        self._since += max(0.0, now - self._last - LONGEST_GAP)
        self._last = now
        return now - self._since >= self._settle_time
