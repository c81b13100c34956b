"""Noise of a camera, and missing depths."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from head_tracking.scene.render import Rendering
from head_tracking.vision.opencv import cv2

_BANK = 64


class SensorNoise:
    """Adds noise to pictures and depths of one size.

    The noise is generated once, over a larger field, and cut at a random position for each image,
    because generating it takes longer than rendering.

    Args:
        size: width and height of the images.
        rng: source of the noise.
        picture: standard deviation of a pixel, 0 to 255.
        depth: standard deviation of a depth at 1 m [m]; it is proportional to the square of the
            depth, as for structured light and stereo.
        holes: share of missing depths, in addition to those at the edges of objects.
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
        """Return a rendering with noise; missing depths are NaN."""
        return Rendering(self.picture(seen.picture), self.depth(seen.depth))

    def picture(self, picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """Return an image with noise, shape (height, width, 3)."""
        part = self._part(picture.shape)
        return np.asarray(cv2.add(picture, self._picture[part], dtype=cv2.CV_8U))

    def depth(self, depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return depths with noise [m], shape (height, width); NaN: missing."""
        part = self._part(depth.shape)
        measured = depth + self._depth[part] * depth**2
        missing = self._holes[part] | ~np.isfinite(depth)
        if self._edges:
            near = cv2.erode(depth, np.ones((3, 3), np.uint8))
            missing |= depth > 1.1 * near
        measured[missing] = np.nan
        return measured

    def _part(self, shape: tuple[int, ...]) -> tuple[slice, slice]:
        """Return a random part of the field."""
        row, column = self._rng.integers(0, _BANK + 1, 2)
        return slice(row, row + shape[0]), slice(column, column + shape[1])
