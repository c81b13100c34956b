"""How fast a coordinate swings to and fro, if it does."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from head_tracking.tracking.motion_filter import Array

_LAG = 1.0 / 6.0  # s between the points that are compared: swings up to 3 Hz can be told
_MEMORY = 1.5  # s
_CLEAR = 20.0  # times the noise; a swing must stand out like this


class SwingRate(NamedTuple):
    """A fit of x(t) - x(t-T) + x(t-2T) - x(t-3T) = 2 cos(wT) (x(t-T) - x(t-2T)), for each c.

    It holds for every swing about any centre; the fit is by least squares, freed of the bias
    that the noise of the points brings in.

    Attributes:
        squares: of the right difference, shape (c,) [m^2].
        products: of both sides, shape (c,) [m^2].
        rate: w, shape (c,) [rad/s]; 0 where no swing is seen.
    """

    squares: Array
    products: Array
    rate: Array

    @staticmethod
    def unknown(coordinates: int) -> SwingRate:
        """Before anything was seen of so many coordinates."""
        zero = np.zeros(coordinates)
        return SwingRate(zero, zero, zero)

    def learned(
        self, stamps: Sequence[float], points: Sequence[Array], variance: Array
    ) -> SwingRate:
        """The rate after another point.

        Args:
            stamps: of all points [s], rising; the new one is the last.
            points: shape (c,) each [m].
            variance: of the points, shape (c,) [m^2].
        """
        newest = stamps[-1]
        if len(stamps) < 5 or stamps[0] > newest - 3.0 * _LAG:
            return self
        a = points[-1]
        b, noise_b = _between(stamps, points, newest - _LAG)
        c, noise_c = _between(stamps, points, newest - 2.0 * _LAG)
        d, _ = _between(stamps, points, newest - 3.0 * _LAG)
        left, right = a - b + c - d, b - c
        bias = (noise_b + noise_c) * variance
        dt = newest - stamps[-2]
        kept = np.exp(-dt / _MEMORY)
        squares = kept * self.squares + right * right - bias
        products = kept * self.products + right * left + bias
        clear = squares > _CLEAR * variance * _MEMORY / dt
        cosine = 0.5 * products / np.where(clear, squares, 1.0)
        rate = np.where(clear, np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0)) / _LAG, 0.0)
        return SwingRate(squares, products, rate)


def _between(stamps: Sequence[float], points: Sequence[Array], time: float) -> tuple[Array, float]:
    """The point at a time between two, and the part of the noise that is left of theirs."""
    after = bisect_right(stamps, time)
    before = after - 1
    share = (time - stamps[before]) / (stamps[after] - stamps[before])
    point = points[before] + share * (points[after] - points[before])
    return point, (1.0 - share) ** 2 + share**2
