"""What things look like: histograms of colours, to tell one person from another."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from head_tracking.vision.camera import Box
from head_tracking.vision.images import Picture
from head_tracking.vision.opencv import cv2

_BINS = (12, 4, 4)


def colours_of(picture: Picture, box: Box) -> npt.NDArray[np.float32]:
    """How the colours of a thing and of what is below it (a person's shirt) are distributed.

    Returns:
        Shares of hue, saturation and value, shape (192,), with a sum of 1; empty outside.
    """
    whole = Box(box.x, box.y, box.width, 1.5 * box.height).clipped(*picture.size)
    part = picture.hsv[whole.slices()]
    if not part.size:
        return np.zeros(0, np.float32)
    counts = cv2.calcHist([part], [0, 1, 2], None, list(_BINS), [0, 180, 0, 256, 0, 256])
    return np.asarray(counts.ravel() / counts.sum(), np.float32)
