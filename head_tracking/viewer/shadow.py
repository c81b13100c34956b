"""The shadow of a robot on the ground, as light from everywhere above makes it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import viser
from PIL import Image, ImageChops, ImageDraw, ImageFilter

_PIXELS = 256
_HIGH = 0.12  # m: what is higher than this casts a paler and softer shadow
_ABOVE = 0.002  # m above the ground, so that they don't flicker through each other


def add_shadow(
    scene: viser.SceneApi, name: str, triangles: npt.NDArray[np.float64], ground: float
) -> Any:
    """Draws it; None if there is nothing to cast one.

    Args:
        scene: gets the shadow.
        name: in the scene.
        triangles: of the robot, shape (N, 3, 3) [m].
        ground: its height [m].
    """
    if not len(triangles):
        return None
    flat = triangles[..., :2]
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    size = 1.6 * float((high - low).max())
    middle = (low + high) / 2.0
    pixels = (flat - middle) / size * _PIXELS + _PIXELS / 2
    near = triangles[..., 2].min(axis=1) < ground + _HIGH
    alpha = ImageChops.lighter(
        _blurred(pixels, 0.05 * _PIXELS, 60), _blurred(pixels[near], 0.02 * _PIXELS, 95)
    )
    picture = np.zeros((_PIXELS, _PIXELS, 4), np.uint8)
    picture[..., 3] = np.asarray(alpha)
    return scene.add_image(
        name, picture, size, size, format="png", cast_shadow=False, receive_shadow=False,
        position=(*middle.tolist(), ground + _ABOVE),
    )  # fmt: skip


def _blurred(pixels: npt.NDArray[np.float64], radius: float, darkness: int) -> Image.Image:
    picture = Image.new("L", (_PIXELS, _PIXELS))
    draw = ImageDraw.Draw(picture)
    for triangle in pixels:
        draw.polygon([(x, y) for x, y in triangle.tolist()], fill=darkness)
    return picture.filter(ImageFilter.GaussianBlur(radius))
