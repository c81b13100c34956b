"""Drawn pictures of what simulated cameras look at: markers, patterns; with alpha."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.vision.opencv import cv2

Colour: TypeAlias = tuple[int, int, int]
Texture: TypeAlias = npt.NDArray[np.uint8]
"""A picture, shape (height, width, 4): blue, green, red, alpha."""


def marker(dictionary: str, number: int, size: int = 320) -> Texture:
    """An ArUco or AprilTag marker with a white border one module wide.

    Args:
        dictionary: OpenCV's name without its prefix, such as ``4X4_50`` or ``APRILTAG_36h11``.
        number: which marker of it.
        size: width of the whole picture in pixels.
    """
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    modules = family.markerSize + 2
    border = size // (modules + 2)
    # (Ubuntu 24.04 has OpenCV 4.6, which calls it drawMarker)
    draw = getattr(cv2.aruco, "generateImageMarker", None) or cv2.aruco.drawMarker
    black = draw(family, number, border * modules)
    framed = cv2.copyMakeBorder(black, *[border] * 4, cv2.BORDER_CONSTANT, value=255)
    return np.asarray(cv2.cvtColor(framed, cv2.COLOR_GRAY2BGRA))


def pattern(rng: np.random.Generator, size: int = 256) -> Texture:
    """Blobs of many greys, as a picture on a wall has corners to hold on to."""
    coarse = rng.integers(30, 226, (12, 12, 3), np.uint8)
    texture = np.full((size, size, 4), 255, np.uint8)
    texture[..., :3] = cv2.resize(coarse, (size, size), interpolation=cv2.INTER_NEAREST)
    return texture


def shaded(colour: Colour, factor: float) -> Colour:
    """Return a colour with another brightness."""
    b, g, r = (min(255, round(c * factor)) for c in colour)
    return b, g, r
