"""What things look like: histograms of colours, to tell one person from another."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Frame, Mask, ellipse_mask
from head_tracking.vision.opencv import cv2

Appearance: TypeAlias = npt.NDArray[np.float32]

_BINS = (12, 4, 4)
_DEEP = 0.35  # m: body and clothes are within this of the face; what is farther is background


def colours_of(frame: Frame, candidate: Candidate, depth: float | None = None) -> Appearance:
    """Return how the colours of a thing, and of what is below it (clothes), are distributed.

    Args:
        frame: the image, which has a picture.
        candidate: what was found in it.
        depth: how far away it is [m], to leave out the background; None: unknown.

    Returns:
        Shares of hue, saturation and value: of the thing, and of what is below it; shape (2, 192).
        The sum of a row is 1, or 0 where nothing of that part is seen.
    """
    box = candidate.box
    below = Box(box.x, box.y + box.height, box.width, 0.35 * box.height)
    rows = [
        _histogram(frame, box, depth, _mask(frame, candidate)),
        # a mask is the whole thing
        _histogram(frame, below, depth) if candidate.mask is None else _NOTHING,
    ]
    return np.stack(rows)


def appearance_distance(a: Appearance, b: Appearance) -> float:
    """Return the Hellinger distance of two appearances in the part in which they differ most.

    Returns:
        0 for equal ones, and where nothing can be compared; 1 for those with nothing in common.
    """
    if not a.size or a.shape != b.shape:
        return 0.0
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    both = (a.sum(axis=1) > 0.0) & (b.sum(axis=1) > 0.0)
    if not both.any():
        return 0.0
    common = np.sqrt(a[both] * b[both]).sum(axis=1).min()
    return math.sqrt(max(0.0, 1.0 - float(common)))


def _mask(frame: Frame, candidate: Candidate) -> Mask:
    """Return which pixels of the box, as far as it is in the image, are the thing."""
    assert frame.picture is not None
    rows, columns = candidate.box.clipped(*frame.picture.size).slices()
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    if candidate.mask is not None and candidate.mask.shape == shape:
        return candidate.mask
    return ellipse_mask(*shape, 1.0) if min(shape) > 0 else np.zeros(shape, np.bool_)


_NOTHING = np.zeros(math.prod(_BINS), np.float32)


def _histogram(frame: Frame, box: Box, depth: float | None, mask: Mask | None = None) -> Appearance:
    """Return the shares of the colours in a box, shape (192,); zeros if it shows nothing."""
    assert frame.picture is not None
    part = frame.picture.hsv[box.clipped(*frame.picture.size).slices()]
    height, width = part.shape[:2]
    if not part.size:
        return _NOTHING
    if mask is None or mask.shape != (height, width):
        mask = np.ones((height, width), np.bool_)
    if depth is not None and frame.depth is not None:
        depths = frame.depth.part(box)
        if depths.shape == mask.shape:
            mask = mask & ~(np.abs(depths - depth) > _DEEP)  # an unknown depth counts
    chosen = np.ascontiguousarray(mask, np.uint8)
    counts = cv2.calcHist([part], [0, 1, 2], chosen, list(_BINS), [0, 180, 0, 256, 0, 256])
    total = float(counts.sum())
    return np.asarray(counts.ravel() / total, np.float32) if total else _NOTHING
