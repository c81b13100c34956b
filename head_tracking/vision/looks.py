"""Appearance of objects: colour histograms that distinguish people."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Frame
from head_tracking.vision.opencv import cv2

Appearance: TypeAlias = npt.NDArray[np.float32]

_BINS = (12, 4, 4)
_DEPTH = 0.35  # m between face and clothes at most; other pixels are background


def colours_of(frame: Frame, candidate: Candidate, depth: float | None = None) -> Appearance:
    """Return colour histograms of an object and of the region below it (clothes).

    Args:
        frame: the image, with colours.
        candidate: the object.
        depth: depth of the object [m], to exclude the background; None: unknown.

    Returns:
        Histograms of hue, saturation and value, shape (2, 192): object, region below. The sum of a
        row is 1, or 0 if that region is not visible.
    """
    box = candidate.box
    below = Box(box.x, box.y + box.height, box.width, 0.35 * box.height)
    rows = [
        _histogram(frame, box, depth, candidate),
        # a mask covers the whole object
        _histogram(frame, below, depth) if candidate.mask is None else _NOTHING,
    ]
    return np.stack(rows)


def appearance_distance(a: Appearance, b: Appearance) -> float:
    """Return the larger Hellinger distance of the two histograms.

    Returns:
        0 (equal, or not comparable) to 1 (no common colour).
    """
    if not a.size or a.shape != b.shape:
        return 0.0
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    both = (a.sum(axis=1) > 0.0) & (b.sum(axis=1) > 0.0)
    if not both.any():
        return 0.0
    common = np.sqrt(a[both] * b[both]).sum(axis=1).min()
    return math.sqrt(max(0.0, 1.0 - float(common)))


_NOTHING = np.zeros(math.prod(_BINS), np.float32)


def _histogram(
    frame: Frame, box: Box, depth: float | None, candidate: Candidate | None = None
) -> Appearance:
    """Return the colour histogram of a box, or of the candidate in it, shape (192,).

    It is 0 if the box is not visible.
    """
    assert frame.picture is not None
    part = frame.picture.hsv[box.clipped(*frame.picture.size).slices()]
    shape = part.shape[:2]
    if not part.size:
        return _NOTHING
    mask = np.ones(shape, np.bool_) if candidate is None else candidate.pixels(shape, 1.0)
    if depth is not None and frame.depth is not None:
        depths = frame.depth.part(box)
        if depths.shape == mask.shape:
            mask = mask & ~(np.abs(depths - depth) > _DEPTH)  # unknown depths are included
    chosen = np.ascontiguousarray(mask, np.uint8)
    counts = cv2.calcHist([part], [0, 1, 2], chosen, list(_BINS), [0, 180, 0, 256, 0, 256])
    total = float(counts.sum())
    return np.asarray(counts.ravel() / total, np.float32) if total else _NOTHING
