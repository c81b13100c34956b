"""Where a target was, and where it goes if it keeps moving as it does."""

from __future__ import annotations

from collections import deque

import numpy as np

from head_tracking.transforms import Vector3

_FITTED = 0.3
"""The motion of so many seconds decides the prediction."""

_JUMP = 0.3  # m: from one sample to the next; farther is another target
_STEPS = 10
_MOVING = 0.02  # m/s: slower targets stand still


class TargetPath:
    """The target's last positions. Times are in nanoseconds.

    Args:
        trail: how long positions are kept [s].
        ahead: how far the prediction goes [s].
    """

    def __init__(self, trail: float, ahead: float) -> None:
        self._trail = round(trail * 1e9)
        self._ahead = ahead
        self._points: deque[tuple[int, Vector3]] = deque()

    def add(self, stamp: int, point: Vector3 | None) -> None:
        """Takes the target's position [m]; None: there is no target."""
        points = self._points
        if point is None:
            points.clear()
            return
        if points:
            last, before = points[-1]
            if stamp <= last:
                if stamp < last:
                    points.clear()  # a recording that starts again
                else:
                    return
            elif sum((a - b) ** 2 for a, b in zip(point, before, strict=True)) > _JUMP**2:
                points.clear()
        points.append((stamp, point))
        while stamp - points[0][0] > self._trail:
            points.popleft()

    def trail(self) -> list[Vector3]:
        """The positions, oldest first [m]."""
        return [point for _, point in self._points]

    def predicted(self) -> list[Vector3]:
        """The way ahead from the last position at constant acceleration [m]; empty at rest.

        The acceleration is that of the parabola nearest to the last positions (least squares).
        """
        if len(self._points) < 4:
            return []
        end = self._points[-1][0]
        recent = [
            ((stamp - end) * 1e-9, point)
            for stamp, point in self._points
            if (end - stamp) * 1e-9 <= _FITTED
        ]
        if len(recent) < 4 or recent[0][0] > -_FITTED / 2:
            return []
        times = np.array([time for time, _ in recent])
        places = np.array([point for _, point in recent])
        acceleration, velocity, _ = np.polyfit(times, places, 2)
        if float(np.linalg.norm(velocity)) < _MOVING:
            return []
        ahead = np.linspace(0.0, self._ahead, _STEPS + 1)[:, None]
        way = places[-1] + velocity * ahead + acceleration * ahead**2
        return [(x, y, z) for x, y, z in way.tolist()]
