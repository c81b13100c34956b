"""Drawn pictures of what simulated cameras look at: people, markers, patterns; with alpha."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.vision.opencv import cv2

Colour: TypeAlias = tuple[int, int, int]
Texture: TypeAlias = npt.NDArray[np.uint8]
"""A picture, shape (height, width, 4): blue, green, red, alpha."""


@dataclass(frozen=True, slots=True)
class Looks:
    """What a drawn person looks like; colours are blue, green, red."""

    skin: Colour = (150, 180, 225)
    hair: Colour = (35, 45, 70)
    shirt: Colour = (150, 80, 40)


def person(looks: Looks, size: int = 384) -> Texture:
    """A head with shoulders, seen from the front; the head is half as wide as the picture."""
    texture = np.zeros((size, size, 4), np.uint8)
    s = size / 384.0
    skin, hair, shirt = looks.skin, looks.hair, looks.shirt

    def ellipse(
        at: tuple[float, float], axes: tuple[float, float], colour: Colour, arc: tuple[int, int]
    ) -> None:
        centre = tuple(round(c * s) for c in at)
        radii = tuple(max(1, round(a * s)) for a in axes)
        cv2.ellipse(texture, centre, radii, 0, *arc, (*colour, 255), -1, cv2.LINE_AA)

    full = (0, 360)
    ellipse((192, 420), (180, 110), shirt, full)
    ellipse((192, 310), (48, 60), _shade(skin, 0.75), full)
    ellipse((192, 150), (106, 132), hair, full)
    ellipse((192, 178), (92, 118), skin, full)
    ellipse((192, 95), (92, 52), hair, (180, 360))
    for side in (-1, 1):
        ellipse((192 + side * 95, 185), (14, 26), _shade(skin, 0.85), full)
        # eye sockets, brows and eyes
        ellipse((192 + side * 40, 158), (32, 19), _shade(skin, 0.72), full)
        ellipse((192 + side * 40, 138), (30, 7), _shade(hair, 0.8), full)
        ellipse((192 + side * 40, 160), (21, 11), (245, 245, 245), full)
        ellipse((192 + side * 40, 160), (11, 11), (40, 30, 25), full)
        ellipse((192 + side * 55, 215), (24, 18), _shade(skin, 1.08), full)
    ellipse((192, 195), (13, 34), _shade(skin, 1.12), full)
    ellipse((192, 222), (20, 8), _shade(skin, 0.6), full)
    ellipse((192, 256), (36, 12), (85, 75, 165), full)
    ellipse((192, 255), (34, 3), (40, 30, 80), full)
    colours = cv2.GaussianBlur(texture[..., :3], (0, 0), 2.0 * s)
    texture[..., :3] = np.where(texture[..., 3:] > 0, colours, texture[..., :3])
    return texture


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


def wall(colour: Colour, rng: np.random.Generator, size: int = 512) -> Texture:
    """A wall that is not quite of one colour, with a skirting board and a few pale pictures."""
    cloud = cv2.resize(rng.normal(0.0, 10.0, (6, 8)).astype(np.float32), (size, size))
    texture = np.full((size, size, 4), 255, np.uint8)
    texture[..., :3] = np.clip(cloud[..., None] + np.array(colour, np.float32), 0, 255)
    for _ in range(5):
        x, y = rng.integers(size // 10, size - size // 4, 2)
        w, h = rng.integers(size // 14, size // 6, 2)
        shade = _shade(colour, float(rng.uniform(0.75, 0.95)))
        cv2.rectangle(texture, (x, y), (x + w, y + h), (*shade, 255), -1)
        cv2.rectangle(texture, (x, y), (x + w, y + h), (*_shade(colour, 0.55), 255), size // 170)
    return texture


def _shade(colour: Colour, factor: float) -> Colour:
    b, g, r = (min(255, round(c * factor)) for c in colour)
    return b, g, r
