"""Smooth transition of the gaze from one target to the next."""

from __future__ import annotations

import math

from head_tracking.transforms import Vector3


def between(start: Vector3, end: Vector3, ratio: float, centre: Vector3) -> Vector3:
    """Return a point on a path around the head from one target to the next, with smooth ends.

    Azimuth, elevation and distance from a centre are interpolated, so that the path passes in front
    of the robot, and not through the head.

    Args:
        start: the former target [m].
        end: the next target [m].
        ratio: share of the duration that has passed, 0 to 1.
        centre: position of the head [m].
    """
    ratio = ratio * ratio * (3.0 - 2.0 * ratio)  # velocity 0 at both ends
    here, there = _spherical(start, centre), _spherical(end, centre)
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
