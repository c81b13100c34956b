"""Depth of an object, from depth images with holes, edges and noise."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_BAND = 0.04
"""Depths within this relative difference belong to one surface."""

_MINIMUM_PIXELS = 4
_LEAST_SHARE = 0.1  # of the region that the surface covers


def surface_depth(depths: npt.NDArray[np.float32], near: float, far: float) -> float | None:
    """Return the median depth [m] of the surface that fills most of a region.

    A region contains holes, and pixels behind and in front of the object. Depths are sorted into
    bins of equal ratio; the fullest interval of one band is the surface. Of several intervals that
    are nearly as full, the nearest is used.

    Args:
        depths: depths of the region [m], any shape; NaN: unknown.
        near: minimum depth [m].
        far: maximum depth [m].

    Returns:
        None if too few depths are known.
    """
    minimum = max(_MINIMUM_PIXELS, _LEAST_SHARE * depths.size)
    valid = depths[np.isfinite(depths) & (depths >= near) & (depths <= far)]
    if valid.size < minimum:
        return None
    logs = np.log(valid)
    low = float(logs.min())
    bins = np.bincount(((logs - low) / (_BAND / 2)).astype(np.int64))
    counts = np.convolve(bins, [1, 1, 1], "same")
    first = int(np.flatnonzero(counts >= 0.7 * counts.max())[0])
    peak = first + int(np.argmax(counts[first : first + 3]))
    middle = low + (peak + 0.5) * _BAND / 2
    surface = valid[np.abs(logs - middle) <= _BAND]
    return None if surface.size < minimum else float(np.median(surface))
