"""The sweep that searches for a lost target."""

from __future__ import annotations

import math

from head_tracking.gaze import PanTiltHead, at_goal
from head_tracking.transforms import JointLimits

_FARTHEST = 3.0  # rad; a joint without limits sweeps so far to either side
_ROW = 0.7  # rad; less than the usual vertical field of view


class Sweep:
    """Sweep from side to side, row by row: straight ahead first, then above and below in turn.

    Args:
        head: the head that is turned.
    """

    def __init__(self, head: PanTiltHead) -> None:
        self._edges = _within(head.pan_limits)
        self._rows = _rows(head.tilt_limits)
        self._right_to_left = True
        self._row = 0
        self._crossing = True

    def goal(self, positions: tuple[float, float]) -> tuple[float, float]:
        """Return pan and tilt to turn to [rad], from the present ones."""
        goal = self._corner
        if at_goal(positions, goal):
            if self._crossing and len(self._rows) > 1:
                self._row = (self._row + 1) % len(self._rows)
            else:
                self._right_to_left = not self._right_to_left
            self._crossing = not self._crossing or len(self._rows) == 1
        return self._corner

    @property
    def _corner(self) -> tuple[float, float]:
        return self._edges[self._right_to_left], self._rows[self._row]


def _within(limits: JointLimits) -> tuple[float, float]:
    return max(limits.lower, -_FARTHEST), min(limits.upper, _FARTHEST)


def _rows(limits: JointLimits) -> list[float]:
    """Return the tilts of the rows, the level one first."""
    lower, upper = _within(limits)
    count = max(1, math.ceil((upper - lower) / _ROW))
    step = (upper - lower) / count
    rows = [lower + (index + 0.5) * step for index in range(count)]
    return sorted(rows, key=lambda tilt: abs(tilt - limits.clamp(0.0)))
