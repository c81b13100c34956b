"""Draw calibration.png: images of a calibration, and the errors of its views before and after."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from head_tracking import Head
from head_tracking.calibration.picture import residual_picture
from head_tracking.cli.calibrate import SIMULATED_MOUNTING
from head_tracking.scene import film
from head_tracking.vision import MarkerParameters, Pixels, camera_with_view

EVERY, SHOWN = 4.0, 3
"""Time between two images on the sheet [s], and their number."""
SIZE = 320, 240
EDGE = 8
"""Width of the white lines between them [pixels]."""


class Kept:
    """Hands on the images of a camera, and keeps some of them."""

    def __init__(self, images: Iterator[tuple[float, Pixels]]) -> None:
        self.shown: list[Pixels] = []
        self._images = images

    def __iter__(self) -> Iterator[tuple[float, Pixels]]:
        following = 0.0
        for stamp, image in self._images:
            if stamp >= following and len(self.shown) < SHOWN:
                self.shown.append(image)
                following = stamp + EVERY
            yield stamp, image


def main() -> None:
    """Calibrate the simulated camera, and write the picture into a folder."""
    with Head.simulated() as head:
        pose = partial(head.pose, "camera_optical_frame", "base_link")
        kept = Kept(
            iter(film("still marker", lambda stamp: pose(stamp=stamp) @ SIMULATED_MOUNTING))
        )
        calibration = head.calibrate(
            iter(kept),
            marker=MarkerParameters("4X4_50", -1, 0.16),
            model=camera_with_view(*SIZE, math.radians(60.0)),
        )
    assert calibration.residuals is not None
    errors = residual_picture(calibration.residuals, SIZE)
    line = np.full((SIZE[1], EDGE, 3), 255, np.uint8)
    sheet = [part for each in (*kept.shown, errors) for part in (each, line)][:-1]
    cv2.imwrite(str(Path(sys.argv[1]) / "calibration.png"), np.concatenate(sheet, axis=1))


if __name__ == "__main__":
    main()
