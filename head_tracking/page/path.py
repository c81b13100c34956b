"""Closed paths for the head to look along."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import RobotModel, Rotation, Vector3

_STEPS = 72  # a multiple of 8, so that the square's corners are points
_DISTANCE = 1.0  # m: from the camera to a path


class ClosedPath:
    """A closed polygon.

    Args:
        points: two different ones or more, in one frame [m].
    """

    def __init__(self, points: Sequence[Vector3]) -> None:
        self._closed = np.array([*points, points[0]], float)
        steps = np.linalg.norm(np.diff(self._closed, axis=0), axis=1)
        self._lengths = np.concatenate([[0.0], steps.cumsum()])

    def at(self, distance: float) -> Vector3:
        """Return the point at a distance from the first one along the path [m]."""
        along = distance % self._lengths[-1]
        x, y, z = (float(np.interp(along, self._lengths, column)) for column in self._closed.T)
        return x, y, z


SHAPES = ("circle", "square", "figure of eight")


def _place(shape: str, angle: float) -> tuple[float, float]:
    """Return the place on a shape of half width 1, by the angle around its centre [rad]."""
    x, y = math.cos(angle), math.sin(angle)
    if shape == "square":
        largest = max(abs(x), abs(y))
        return x / largest, y / largest
    return x, x * y if shape == "figure of eight" else y  # Gerono's lemniscate is half as high


def path_ahead(model: RobotModel, head: PanTiltHead, shape: str, size: float) -> ClosedPath:
    """Return a path 1 m before the camera at joint positions 0, in the model's root.

    Args:
        model: has the head.
        head: looks along the path.
        shape: one of `SHAPES`.
        size: half the path's width [m].

    Raises:
        ValueError: there is no such shape.
    """
    if shape not in SHAPES:
        raise ValueError(f"There is no shape {shape!r}: choose {', '.join(SHAPES)}.")
    at_zero = dict.fromkeys(model.independent_joints, 0.0)
    camera = model.transform(model.root, head.pointing_frame, at_zero)
    ahead: Vector3 = camera.rotation @ head.pointing_axis
    turn = Rotation.from_rpy(0.0, 0.0, math.atan2(ahead[1], ahead[0]))
    cx, cy, cz = (c + _DISTANCE * a for c, a in zip(camera.translation, ahead, strict=True))
    points = []
    for step in range(_STEPS):
        right, up = _place(shape, math.tau * step / _STEPS)
        x, y, z = turn @ (0.0, -size * right, size * up)
        points.append((cx + x, cy + y, cz + z))
    return ClosedPath(points)
