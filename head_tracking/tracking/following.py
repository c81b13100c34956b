"""A joint that does not follow its commands, by its position."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.gaze import AT_GOAL

_FOLLOWED = 0.2  # of the commanded way; a joint that moved less does not follow
_PATIENCE = 0.8  # s


@dataclass(frozen=True, slots=True)
class NotFollowing:
    """A joint that stands still although its goal is elsewhere.

    Attributes:
        joint: its name.
        commanded: the way that it was commanded to move in the window that was judged [rad].
        measured: the way that it moved in that window [rad].
    """

    joint: str
    commanded: float
    measured: float


class FollowingWatch:
    """Detect a joint that does not follow its commands: relaxed, shut down or blocked.

    The tracker, the actions and the joint controllers ask this class. What a servo that stands
    drives only the bus knows; its diagnosis tells sooner, and why. A joint does not follow if it
    has moved less than 20 % of the commanded way, and less than `AT_GOAL`, within `patience`, and
    has not arrived at its goal. It follows again once it has moved by more than that, or its goal
    is reached or lies on its other side.

    Args:
        joint: name of the joint.
        patience: the length of the window that is judged [s].

    Attributes:
        joint: as given.
        patience: as given; may change at any time.
        problem: the result of the last window; None: the joint follows, or nothing is known.
    """

    def __init__(self, joint: str, patience: float = _PATIENCE) -> None:
        self.joint = joint
        self.patience = patience
        self._side = 0.0
        self.restart()

    def restart(self) -> None:
        """Forget what was measured."""
        self.problem: NotFollowing | None = None
        self._since = math.nan

    def check(self, goal: float, speed: float, position: float, now: float) -> NotFollowing | None:
        """Return the problem if the joint does not follow.

        Args:
            goal: of the latest command [rad].
            speed: of the latest command [rad/s], without sign.
            position: as measured [rad].
            now: the time [s].
        """
        way = goal - position
        if abs(way) < AT_GOAL or way * self._side < 0.0:
            self.restart()
        self._side = way
        if math.isnan(self._since):
            self._since = self._last = now
            self._commanded = 0.0
            self._lowest = self._highest = position
            return self.problem
        self._commanded += min(speed * (now - self._last), abs(way))
        self._last = now
        self._lowest, self._highest = min(position, self._lowest), max(position, self._highest)
        moved = self._highest - self._lowest
        if moved > AT_GOAL:
            self.problem = None
        if now - self._since > self.patience and self._commanded > AT_GOAL:
            stands = moved < min(_FOLLOWED * self._commanded, AT_GOAL)
            self.problem = NotFollowing(self.joint, self._commanded, moved) if stands else None
            self._since = math.nan
        return self.problem
