"""The definition of "arrived", for joints and for the pointing axis."""

from __future__ import annotations

from collections.abc import Sequence

AT_GOAL = 0.03
"""Largest error of a joint that is at its goal [rad], with dead band, play and sag."""


def at_goal(positions: Sequence[float], goals: Sequence[float]) -> bool:
    """Return whether every joint is at its goal [rad]."""
    return all(abs(a - b) < AT_GOAL for a, b in zip(positions, goals, strict=True))


class Arrival:
    """Detect that the error of a head stays small. Times are in seconds, on any clock.

    Args:
        tolerance: the largest miss that counts as arrived [rad].
        settle_time: how long the miss has to stay below it [s].
    """

    def __init__(self, tolerance: float, settle_time: float) -> None:
        self._tolerance = tolerance
        self._settle_time = settle_time
        self._since: float | None = None

    def step(self, miss: float, now: float) -> bool:
        """Accept the present miss [rad] and return whether the head has arrived."""
        if miss > self._tolerance:
            self._since = None
            return False
        if self._since is None:
            self._since = now
        return now - self._since >= self._settle_time
