"""A way that goes round and round, as a target to look at."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from head_tracking.transforms import Vector3

_STEPS = 72


class Path:
    """Straight lines from point to point, and back to the first.

    Args:
        points: two or more, in one frame [m].

    Raises:
        ValueError: there are fewer, or all are the same.
    """

    def __init__(self, points: Sequence[Vector3]) -> None:
        self.points = tuple(points)
        closed = np.array([*points, *points[:1]], float)
        if len(points) < 2:
            raise ValueError("a path needs two points or more: add some")
        self._lengths = np.concatenate(
            [[0.0], np.linalg.norm(np.diff(closed, axis=0), axis=1).cumsum()]
        )
        if self.length <= 0.0:
            raise ValueError("all points of the path are the same: add another")
        self._closed = closed

    @property
    def length(self) -> float:
        """Of one round [m]."""
        return float(self._lengths[-1])

    def at(self, distance: float) -> Vector3:
        """The point after so many metres from the first one on [m]."""
        along = distance % self.length
        x, y, z = (float(np.interp(along, self._lengths, column)) for column in self._closed.T)
        return x, y, z


def circle(turn: float) -> tuple[float, float]:
    """Radius 1."""
    return math.cos(turn), math.sin(turn)


def square(turn: float) -> tuple[float, float]:
    """Half an edge is 1."""
    x, y = math.cos(turn), math.sin(turn)
    largest = max(abs(x), abs(y))
    return x / largest, y / largest


def figure_of_eight(turn: float) -> tuple[float, float]:
    """Gerono's lemniscate: 2 wide, 1 high."""
    return math.cos(turn), math.sin(turn) * math.cos(turn)


SHAPES: Mapping[str, Callable[[float], tuple[float, float]]] = {
    "circle": circle,
    "square": square,
    "figure of eight": figure_of_eight,
}
"""Shapes in a plane, by the turn around their middle, 0 to tau."""


def shaped(shape: str, middle: Vector3, right: Vector3, up: Vector3, size: float) -> Path:
    """A path of a shape.

    Args:
        shape: one of SHAPES.
        middle: of the shape [m].
        right: where its x points, of length 1.
        up: where its y points, of length 1.
        size: half its width [m].
    """
    points: list[Vector3] = []
    for step in range(_STEPS):
        # the square's corners are steps, too
        x, y = SHAPES[shape](math.tau * step / _STEPS)
        a, b, c = (m + size * (x * r + y * u) for m, r, u in zip(middle, right, up, strict=True))
        points.append((a, b, c))
    return Path(points)
