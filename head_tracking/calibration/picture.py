"""Draw the errors of a calibration's views before and after."""

from __future__ import annotations

import numpy as np

from head_tracking.calibration.geometry import Residuals
from head_tracking.vision.images import Pixels
from head_tracking.vision.opencv import cv2

_BEFORE, _AFTER, _SEEN = (60, 60, 220), (60, 170, 60), (90, 90, 90)
_SHARE = 16  # of a pixel, for OpenCV


def residual_picture(residuals: Residuals, size: tuple[int, int]) -> Pixels:
    """Return a picture of all views in one, shape (height, width, 3).

    A grey dot is a seen corner. Lines lead to where it is expected: red by the model, green by the
    calibrated model.

    Args:
        residuals: of the views.
        size: width and height of the images [px].
    """
    drawn: Pixels = np.full((size[1], size[0], 3), 255, np.uint8)
    seen = residuals.seen + np.array(size) / 2.0
    for colour, missed in ((_BEFORE, residuals.before), (_AFTER, residuals.after)):
        for start, end in zip(_fixed(seen), _fixed(seen + missed), strict=True):
            cv2.line(drawn, start, end, colour, 2, cv2.LINE_AA, 4)
    for middle in _fixed(seen):
        cv2.circle(drawn, middle, 2 * _SHARE, _SEEN, -1, cv2.LINE_AA, 4)
    return drawn


def _fixed(points: np.ndarray) -> list[list[int]]:
    fixed: list[list[int]] = np.round(points * _SHARE).astype(int).tolist()
    return fixed
