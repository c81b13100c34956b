"""What a sensor makes of a rendering: noise, and holes in the depth."""

from __future__ import annotations

import numpy as np

from head_tracking.scene.render import Rendering
from head_tracking.vision.opencv import cv2

_BANK = 64


class SensorNoise:
    """Adds noise to pictures and depths of one size.

    Noise is drawn once, over a larger field, and taken from a random place of it for each frame:
    drawing it anew takes longer than everything else.

    Args:
        size: width and height of the pictures.
        rng: chooses the noise.
        picture: standard deviation of a pixel's brightness, 0 to 255.
        depth: standard deviation of a depth at 1 m [m]; it grows with the square of the depth, as
            with structured light and stereo.
        holes: the share of depths that are missing, besides those at the edges of things.
    """

    def __init__(
        self,
        size: tuple[int, int],
        rng: np.random.Generator,
        picture: float,
        depth: float,
        holes: float,
    ) -> None:
        width, height = size
        field = (height + _BANK, width + _BANK)
        self._rng = rng
        self._picture = rng.normal(0.0, picture, (*field, 3)).round().astype(np.int16)
        self._depth = rng.normal(0.0, depth, field).astype(np.float32)
        self._holes = rng.random(field) < holes
        self._edges = depth > 0 or holes > 0

    def __call__(self, seen: Rendering) -> Rendering:
        """The same with noise; a depth that could not be measured is NaN."""
        height, width = seen.depth.shape
        row, column = self._rng.integers(0, _BANK + 1, 2)
        part = (slice(row, row + height), slice(column, column + width))
        picture = cv2.add(seen.picture, self._picture[part], dtype=cv2.CV_8U)
        depth = seen.depth + self._depth[part] * seen.depth**2
        missing = self._holes[part] | ~np.isfinite(seen.depth)
        if self._edges:
            near = cv2.erode(seen.depth, np.ones((3, 3), np.uint8))
            missing |= seen.depth > 1.1 * near
        depth[missing] = np.nan
        return Rendering(picture, depth)
