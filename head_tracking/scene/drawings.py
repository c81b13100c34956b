"""Textures: pictures, markers and patterns."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.vision.markers import marker_family
from head_tracking.vision.opencv import cv2

Colour: TypeAlias = tuple[int, int, int]
Texture: TypeAlias = npt.NDArray[np.uint8]
"""An image, shape (height, width, 4): blue, green, red, alpha."""

_MARKER, _BALL = 320, 128  # pixels: width of their textures
_PICTURES = Path(__file__).with_name("pictures")


@cache
def picture(name: str) -> Texture:
    """Return the picture in a file of the folder `pictures`, by its name."""
    read = cv2.imread(str(_PICTURES / name), cv2.IMREAD_UNCHANGED)
    return np.asarray(read if read.shape[2] == 4 else cv2.cvtColor(read, cv2.COLOR_BGR2BGRA))


def marker(dictionary: str, number: int) -> Texture:
    """Return an ArUco or AprilTag marker with a white border of one module.

    Args:
        dictionary: OpenCV's name without its prefix, such as ``4X4_50`` or ``APRILTAG_36h11``.
        number: number of the marker.
    """
    family = marker_family(dictionary)
    modules = family.markerSize + 2
    border = _MARKER // (modules + 2)
    # OpenCV 4.6 (Ubuntu 24.04) calls it drawMarker
    draw = getattr(cv2.aruco, "generateImageMarker", None) or cv2.aruco.drawMarker
    black = draw(family, number, border * modules)
    framed = cv2.copyMakeBorder(black, *[border] * 4, cv2.BORDER_CONSTANT, value=255)
    return np.asarray(cv2.cvtColor(framed, cv2.COLOR_GRAY2BGRA))


def pattern(rng: np.random.Generator) -> Texture:
    """Return a random pattern with many corners."""
    coarse = rng.integers(30, 226, (12, 12, 3), np.uint8)
    texture = np.full((256, 256, 4), 255, np.uint8)
    texture[..., :3] = cv2.resize(coarse, (256, 256), interpolation=cv2.INTER_NEAREST)
    return texture


@lru_cache(maxsize=64)
def ball(colour: Colour) -> Texture:
    """Return a matt ball, lit from above; it fills the texture."""
    radii = (np.arange(_BALL) + 0.5) * 2.0 / _BALL - 1.0
    x, y = np.meshgrid(radii, radii)
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    shade = 0.65 + 0.35 * np.clip(-0.35 * x - 0.8 * y + 0.5 * z, 0.0, 1.0)
    texture = np.full((_BALL, _BALL, 4), 255, np.uint8)
    texture[..., :3] = np.clip(shade[..., None] * np.array(colour), 0, 255)
    texture[..., 3] = np.clip((1.0 - np.hypot(x, y)) * _BALL / 2.0 * 255 + 127, 0, 255)
    return texture
