"""A joint that does not follow its commands, by its position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from head_tracking.gaze import AT_GOAL

_FOLLOWED = 0.2  # of the commanded distance; a joint that moved less does not follow
_PATIENCE = 0.8  # s
_LONGEST_GAP = 0.04  # s; a busy machine or a slow bus delays commands as well as measurements


class FollowingWatch:
    """Detect a joint that does not follow its commands: relaxed, shut down or blocked.

    The tracker, the actions and the stream of set-points use this class. The diagnosis of the
    servo bus, which reads the servos' registers, is faster and gives a cause. A joint does not
    follow if it has moved less than 20 % of the commanded distance, and less than `AT_GOAL`, within
    `patience`, and has not arrived at its goal. It follows again once it has moved by more than
    that, or its goal is reached or lies on its other side. Of a gap in the measurements at most
    `_LONGEST_GAP` counts.

    Args:
        patience: length of the window that is judged [s].

    Attributes:
        patience: as given; may change at any time.
    """

    def __init__(self, patience: float = _PATIENCE) -> None:
        self.patience = patience
        self._side = 0.0
        self.restart()

    def restart(self) -> None:
        """Discard what was measured."""
        self._stands = False
        self._since = math.nan

    def check(self, goal: float, speed: float, position: float, now: float) -> bool:
        """Return whether the joint stands although its goal is elsewhere.

        Args:
            goal: of the latest command [rad].
            speed: of the latest command [rad/s], without sign.
            position: as measured [rad].
            now: the time [s].
        """
        left = goal - position
        if abs(left) < AT_GOAL or left * self._side < 0.0:
            self.restart()
        self._side = left
        if math.isnan(self._since):
            self._since = self._last = now
            self._commanded = 0.0
            self._lowest = self._highest = position
            return self._stands
        passed, self._last = now - self._last, now
        self._since += max(0.0, passed - _LONGEST_GAP)
        self._commanded += min(speed * min(passed, _LONGEST_GAP), abs(left))
        self._lowest, self._highest = min(position, self._lowest), max(position, self._highest)
        moved = self._highest - self._lowest
        if moved > AT_GOAL:
            self._stands = False
        if now - self._since > self.patience and self._commanded > AT_GOAL:
            self._stands = moved < min(_FOLLOWED * self._commanded, AT_GOAL)
            self._since = math.nan
        return self._stands


def stalled(
    watches: Mapping[str, FollowingWatch],
    goals: Sequence[float],
    speeds: Sequence[float],
    positions: Sequence[float],
    stamp: float,
) -> str:
    """Return a sentence with the joints that do not follow their commands; empty: all follow.

    Args:
        watches: one for each joint, by its name.
        goals: goals of the latest commands [rad].
        speeds: speeds of the latest commands [rad/s].
        positions: measured positions [rad].
        stamp: time of that measurement [s].
    """
    standing = [
        joint
        for (joint, watch), goal, speed, position in zip(
            watches.items(), goals, speeds, positions, strict=True
        )
        if watch.check(goal, speed, position, stamp)
    ]
    names = " and ".join(standing)
    return f"{names} not following commands: relaxed, shut down or blocked?" if standing else ""
