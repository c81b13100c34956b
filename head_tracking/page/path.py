"""Closed paths for the head to look along."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import RobotModel, Vector3

_STEPS = 72  # a multiple of 8, so that the square's corners are points
_DISTANCE = 1.0  # m: from the camera to a path


class ClosedPath:
    """A closed polygon.

    Args:
        points: two different ones or more, in one frame [m], shape (points, 3).
    """

    def __init__(self, points: npt.ArrayLike) -> None:
        around = np.asarray(points, float)
        self._closed = np.vstack([around, around[:1]])
        steps = np.linalg.norm(np.diff(self._closed, axis=0), axis=1)
        self._lengths = np.concatenate([[0.0], steps.cumsum()])

    def at(self, distance: float) -> Vector3:
        """Return the point at a distance from the first one along the path [m]."""
        along = distance % self._lengths[-1]
        x, y, z = (float(np.interp(along, self._lengths, column)) for column in self._closed.T)
        return x, y, z


SHAPES = ("circle", "square", "figure of eight")


def _outline(shape: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return x and y of the points of a shape of half width 1."""
    angles = np.linspace(0.0, math.tau, _STEPS, endpoint=False)
    x, y = np.cos(angles), np.sin(angles)
    if shape == "square":
        largest = np.maximum(abs(x), abs(y))
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
    heading = math.atan2(ahead[1], ahead[0])
    right, up = (math.sin(heading), -math.cos(heading), 0.0), (0.0, 0.0, 1.0)
    centre = np.array(camera.translation) + _DISTANCE * np.array(ahead)
    x, y = _outline(shape)
    return ClosedPath(centre + size * (np.outer(x, right) + np.outer(y, up)))
