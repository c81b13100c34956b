"""Draw calibration.png: images of a calibration, and the errors of its views before and after."""

import math
import sys
from collections.abc import Iterable, Iterator
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


def keeping(
    images: Iterable[tuple[float, Pixels]], shown: list[Pixels]
) -> Iterator[tuple[float, Pixels]]:
    """Hand on images with their stamps [s], and add some of them to a list."""
    following = 0.0
    for stamp, image in images:
        if stamp >= following and len(shown) < SHOWN:
            shown.append(image)
            following = stamp + EVERY
        yield stamp, image


def main() -> None:
    """Calibrate the simulated camera, and write the picture into a folder."""
    with Head.simulated() as head:
        pose = partial(head.pose, "camera_optical_frame", "base_link")
        images = film("still marker", lambda stamp: pose(stamp=stamp) @ SIMULATED_MOUNTING)
        shown: list[Pixels] = []
        calibration = head.calibrate(
            keeping(images, shown),
            marker=MarkerParameters("4X4_50", -1, 0.16),
            model=camera_with_view(*SIZE, math.radians(60.0)),
        )
    assert calibration.residuals is not None
    errors = residual_picture(calibration.residuals, SIZE)
    line = np.full((SIZE[1], EDGE, 3), 255, np.uint8)
    sheet = [part for each in (*shown, errors) for part in (each, line)][:-1]
    cv2.imwrite(str(Path(sys.argv[1]) / "calibration.png"), np.concatenate(sheet, axis=1))


if __name__ == "__main__":
    main()
