"""Detector of the nearest object in a depth image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from head_tracking.parameters import parameter
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Detector, Frame, Mask
from head_tracking.vision.opencv import cv2

_COLUMNS = 160  # of the reduced depth image, about


@dataclass(frozen=True, slots=True)
class NearestParameters:
    """Definition of the nearest object."""

    thickness: float = parameter(
        0.2, "Maximum depth of the object behind its nearest point.", unit="m", minimum=0.01,
        maximum=5.0,
    )  # fmt: skip
    min_blob: float = parameter(
        0.001, "Smallest blob, as a share of the image.", minimum=1e-5, maximum=1.0
    )
    near: float = parameter(0.3, "Minimum depth.", unit="m", minimum=0.0, maximum=100.0)
    far: float = parameter(2.0, "Maximum depth.", unit="m", minimum=0.01, maximum=100.0)


class NearestDetector(Detector):
    """Detects the nearest connected region of a depth image; needs no colours."""

    Parameters = NearestParameters

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """Return the nearest region, if there is one."""
        if frame.depth is None:
            return []
        p = self.parameters
        width, height = frame.depth.size
        step = max(1, width // _COLUMNS)
        every = slice(None, None, step)
        depths = frame.depth.metres(every, every)
        # remove single wrong depths
        depths = cv2.medianBlur(np.nan_to_num(depths, nan=1e6), 3)
        counts = (depths >= p.near) & (depths <= p.far)
        least = max(3, round(p.min_blob * depths.size))
        if int(counts.sum()) < least:
            return []
        first = float(depths[counts].min())
        for start in np.arange(first, p.far, p.thickness / 2):
            slab = counts & (depths >= start) & (depths <= start + p.thickness)
            if int(slab.sum()) < least:
                continue
            count, labels, stats, centres = cv2.connectedComponentsWithStats(slab.astype(np.uint8))
            largest = 1 + int(np.argmax(stats[1:count, cv2.CC_STAT_AREA]))
            if stats[largest, cv2.CC_STAT_AREA] >= least:
                x, y, w, h, area = stats[largest].tolist()
                blob = labels[y : y + h, x : x + w] == largest
                box = Box(x * step, y * step, w * step, h * step).clipped(width, height)
                u, v = ((centres[largest] + 0.5) * step - 0.5).tolist()
                return [
                    Candidate(
                        box,
                        (u, v),
                        min(1.0, 0.5 + area / (8 * least)),
                        mask=_enlarged(blob, step)[: int(box.height), : int(box.width)],
                    )
                ]
        return []


def _enlarged(mask: Mask, factor: int) -> Mask:
    """Return a mask with each pixel repeated `factor` times in both directions."""
    return np.repeat(np.repeat(mask, factor, axis=0), factor, axis=1)
