"""Looking for a lost target: where a sweep over the reachable field goes."""

from __future__ import annotations

import math

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import JointLimits

_FARTHEST = 3.0  # rad; a joint without limits sweeps so far to either side
_ROW = 0.7  # rad; a camera sees a little more than this from top to bottom
_ARRIVED = 0.03  # rad


class Sweep:
    """From side to side, row by row: first straight ahead, then above and below in turn.

    Args:
        head: the head that looks.
    """

    def __init__(self, head: PanTiltHead) -> None:
        self._edges = _within(head.pan_limits)
        self._rows = _rows(head.tilt_limits)
        self._right_to_left = True
        self._row = 0
        self._crossing = True

    def goal(self, positions: tuple[float, float]) -> tuple[float, float]:
        """Where to turn [rad] from the pan and tilt where the head is."""
        goal = self._corner
        if all(abs(a - b) < _ARRIVED for a, b in zip(positions, goal, strict=True)):
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
    """Tilts from top to bottom, so that nothing between the limits is left out, level first."""
    lower, upper = _within(limits)
    count = max(1, math.ceil((upper - lower) / _ROW))
    step = (upper - lower) / count
    rows = [lower + (index + 0.5) * step for index in range(count)]
    return sorted(rows, key=lambda tilt: abs(tilt - limits.clamp(0.0)))
