"""Smooth transition of the gaze from one target to the next."""

from __future__ import annotations

import math

from head_tracking.transforms import Vector3


class Transition:
    """Move the gaze from one point to another on a path around the head.

    Azimuth, elevation and distance from a centre are interpolated, so that the path passes in front
    of the robot, and not through the head.
    """

    def __init__(self) -> None:
        self._start: Vector3 | None = None
        self._since = 0.0
        self._duration = 0.0

    def begin(self, start: Vector3, now: float, duration: float) -> None:
        """Start from `start` [m] at the time `now`, to arrive after `duration` [s]."""
        self._start, self._since, self._duration = start, now, duration

    def under_way(self, now: float) -> bool:
        """Return whether the transition has not ended yet."""
        return self._start is not None and now - self._since < self._duration

    def at(self, end: Vector3, now: float, centre: Vector3) -> Vector3:
        """Return the point to look at now.

        Args:
            end: the new target [m].
            now: the time [s].
            centre: position of the head [m].
        """
        if self._start is None or not self.under_way(now):
            return end
        ratio = (now - self._since) / self._duration
        ratio = ratio * ratio * (3.0 - 2.0 * ratio)  # velocity 0 at both ends
        here, there = _spherical(self._start, centre), _spherical(end, centre)
        return _point(tuple(a + ratio * (b - a) for a, b in zip(here, there, strict=True)), centre)


def _spherical(point: Vector3, centre: Vector3) -> Vector3:
    x, y, z = (a - b for a, b in zip(point, centre, strict=True))
    flat = math.hypot(x, y)
    return math.atan2(y, x), math.atan2(z, flat), math.hypot(flat, z)


def _point(spherical: tuple[float, ...], centre: Vector3) -> Vector3:
    azimuth, elevation, distance = spherical
    flat = distance * math.cos(elevation)
    return (
        centre[0] + flat * math.cos(azimuth),
        centre[1] + flat * math.sin(azimuth),
        centre[2] + distance * math.sin(elevation),
    )
