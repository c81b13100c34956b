"""Detector of objects of one colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from head_tracking.parameters import parameter
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Detector, Frame
from head_tracking.vision.opencv import cv2

_MAXIMUM = 8  # detections
_OPENING = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class ColourParameters:
    """The colour."""

    hue: float = parameter(
        24.0, "Red 0, yellow 60, green 120, blue 240.", unit="deg", minimum=0.0, maximum=360.0
    )
    hue_tolerance: float = parameter(
        14.0, "Largest difference of the hue.", unit="deg", minimum=1.0, maximum=180.0
    )
    min_saturation: float = parameter(
        0.55, "Minimum saturation of a pixel.", minimum=0.0, maximum=1.0
    )
    min_value: float = parameter(0.25, "Minimum brightness of a pixel.", minimum=0.0, maximum=1.0)
    min_area: float = parameter(
        0.0004, "Smallest blob, as a share of the image.", minimum=0.0, maximum=1.0
    )


class ColourDetector(Detector):
    """Detects connected regions of one colour."""

    Parameters = ColourParameters

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """Return the largest regions."""
        if frame.picture is None:
            return []
        p = self.parameters
        mask = cv2.morphologyEx(_inside(frame.picture.hsv, p), cv2.MORPH_OPEN, _OPENING)
        if not cv2.countNonZero(mask):
            return []
        count, labels, stats, centres = cv2.connectedComponentsWithStats(mask)
        width, height = frame.picture.size
        least = max(4.0, p.min_area * width * height)
        found = []
        for i in np.argsort(-stats[1:count, cv2.CC_STAT_AREA])[:_MAXIMUM] + 1:
            x, y, w, h, area = stats[i].tolist()
            if area < least:
                break
            u, v = centres[i].tolist()
            # an object fills much of its box; scattered pixels do not
            fill = area / (w * h)
            found.append(
                Candidate(
                    Box(x, y, w, h),
                    (u, v),
                    min(1.0, fill / 0.6) * min(1.0, 0.5 + area / (8 * least)),
                    mask=labels[y : y + h, x : x + w] == i,
                )
            )
        return found


def _inside(hsv: npt.NDArray[np.uint8], p: ColourParameters) -> npt.NDArray[np.uint8]:
    """Return 255 for pixels of the colour, shape (height, width)."""
    hues = 2.0 * np.arange(256)
    away = np.abs((hues - p.hue + 180.0) % 360.0 - 180.0)  # hues are cyclic
    near = np.where(away <= p.hue_tolerance, 255, 0).astype(np.uint8)
    least = (0, round(255 * p.min_saturation), round(255 * p.min_value))
    bright = cv2.inRange(hsv, least, (179, 255, 255))
    return np.asarray(cv2.LUT(cv2.extractChannel(hsv, 0), near) & bright)
