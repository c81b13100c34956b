"""Depths of things, from depth images with holes, edges and noise."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

_BAND = 0.04
"""Depths within this share of each other are of one surface."""

_LEAST_PIXELS = 4


class SurfaceDepth(NamedTuple):
    """How far away a thing is.

    Attributes:
        metres: the median depth of its surface [m].
        share: of the pixels of the thing, how many lie on that surface, 0 to 1.
    """

    metres: float
    share: float


def surface_depth(
    depths: npt.NDArray[np.float32],
    near: float,
    far: float,
    least_share: float = 0.1,
    expected: float | None = None,
) -> SurfaceDepth | None:
    """The depth of the surface that fills most of a region.

    A region holds holes, and pixels of what is behind or before the thing. Depths are sorted into
    bins of equal ratio; the fullest stretch of one band's width is the surface, and its median
    is the depth. Where several stretches are nearly as full, the nearest one is taken, or the one
    nearest to what is expected.

    Args:
        depths: of the region [m], any shape; NaN where unknown.
        near: nearest depth that counts [m].
        far: farthest depth that counts [m].
        least_share: of the region, that has to be on the surface.
        expected: about how far away it should be [m].

    Returns:
        None where too little is known.
    """
    total = depths.size
    valid = depths[np.isfinite(depths) & (depths >= near) & (depths <= far)]
    if valid.size < max(_LEAST_PIXELS, least_share * total):
        return None
    logs = np.log(valid)
    low = float(logs.min())
    bins = np.bincount(((logs - low) / (_BAND / 2)).astype(np.int64))
    stretches = np.convolve(bins, [1, 1, 1], "same")
    peaks = np.flatnonzero(stretches >= 0.7 * stretches.max())
    if expected is None:
        peak = peaks[0] + int(np.argmax(stretches[peaks[0] : peaks[0] + 3]))
    else:
        peak = peaks[np.argmin(np.abs(low + (peaks + 0.5) * _BAND / 2 - math.log(expected)))]
    middle = low + (peak + 0.5) * _BAND / 2
    surface = valid[np.abs(logs - middle) <= _BAND]
    if surface.size < max(_LEAST_PIXELS, least_share * total):
        return None
    return SurfaceDepth(float(np.median(surface)), surface.size / total)
