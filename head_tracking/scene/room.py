"""The room of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from head_tracking.scene.drawings import Colour, Texture, shaded
from head_tracking.scene.objects import Panel, Thing, Wall
from head_tracking.vision.opencv import cv2

_X0, _X1, _Y0, _Y1, _Z0, _Z1 = -2.5, 3.5, -2.5, 2.5, -0.9, 1.7
"""Sides of the room [m]; the robot stands on a table."""

_SCALE = 220  # pixels per metre
_SOFT = 41  # pixels of a shadow's edge
_COARSE = 8  # pixels of the coarse brightness towards the edges
_OAK, _WHITE = (92, 128, 168), (232, 236, 238)
_BOOKS = (
    (70, 80, 150),
    (120, 90, 60),
    (80, 120, 90),
    (90, 130, 160),
    (140, 130, 110),
    (90, 70, 80),
)


def room(rng: np.random.Generator) -> dict[str, Thing]:
    """Return four walls, a floor and a ceiling, 6 m by 5 m, and the table under the robot."""
    up, x, y = _Z1 - _Z0, _X1 - _X0, _Y1 - _Y0
    return {
        "front": Wall(_front(rng), (_X1, _Y1, _Z1), (0, -y, 0), (0, 0, -up)),
        "left": Wall(_left(rng), (_X0, _Y1, _Z1), (x, 0, 0), (0, 0, -up)),
        "right": Wall(_right(rng), (_X1, _Y0, _Z1), (-x, 0, 0), (0, 0, -up)),
        "back": Wall(_wall(y, (196, 200, 206), rng), (_X0, _Y0, _Z1), (0, y, 0), (0, 0, -up)),
        "floor": Wall(_floor(rng), (_X1, _Y1, _Z0), (0, -y, 0), (-x, 0, 0)),
        "ceiling": Wall(_ceiling(), (_X0, _Y1, _Z1), (0, -y, 0), (x, 0, 0)),
        "table": Panel(_table(rng), (0.45, 0.7, -0.01), (0, -1.4, 0), (-0.8, 0, 0)),
    }


def bench(distance: float, height: float) -> dict[str, Thing]:
    """Return a white bench in front of the robot.

    Args:
        distance: distance of its middle [m].
        height: height of its top [m].
    """
    top, front = _Surface(2.0, 0.3, _WHITE), _Surface(2.0, height - _Z0, shaded(_WHITE, 0.8))
    front.box(0, 0, 2.0, 0.012, shaded(_WHITE, 0.55))
    for k in range(4):
        front.box(0.02 + 0.49 * k, 0.05, 0.47, height - _Z0 - 0.1, shaded(_WHITE, 0.86))
    x = distance - 0.15
    return {
        "bench front": Panel(front.texture, (x, 1.0, height), (0, -2.0, 0), (0, 0, _Z0 - height)),
        "bench top": Panel(top.texture, (x + 0.3, 1.0, height), (0, -2.0, 0), (-0.3, 0, 0)),
    }


class _Surface:
    """Texture of a surface; positions are relative to its upper left corner [m]."""

    def __init__(self, width: float, height: float, colour: Colour) -> None:
        size = round(height * _SCALE), round(width * _SCALE)
        self.texture: Texture = np.full((*size, 4), 255, np.uint8)
        self.texture[..., :3] = colour

    def box(self, x: float, y: float, width: float, height: float, colour: Colour) -> None:
        """Paint a rectangle."""
        ends = np.round(np.array([[x, y], [x + width, y + height]]) * _SCALE * 16).astype(int)
        cv2.rectangle(self.texture, *map(tuple, ends.tolist()), (*colour, 255), -1, cv2.LINE_AA, 4)

    def disc(self, x: float, y: float, a: float, b: float, colour: Colour) -> None:
        """Paint an ellipse with semi-axes a, b."""
        at, axes = np.round(np.array([[x, y], [a, b]]) * _SCALE).astype(int).tolist()
        cv2.ellipse(self.texture, at, axes, 0, 0, 360, (*colour, 255), -1, cv2.LINE_AA)

    def shade(self, x: float, y: float, width: float, height: float, by: float) -> None:
        """Multiply the brightness of a rectangle by a factor, with a soft edge."""
        ends = np.array([[y, x], [y + height, x + width]]) * _SCALE
        (top, left), (bottom, right) = ends.astype(int).tolist()
        margin = 2 * _SOFT
        cover = np.zeros((bottom - top + 2 * margin, right - left + 2 * margin), np.float32)
        cover[margin:-margin, margin:-margin] = by - 1.0
        for _ in range(2):
            cover = cv2.blur(cover, (_SOFT, _SOFT))
        part = self.texture[max(top - margin, 0) : bottom + margin,
                            max(left - margin, 0) : right + margin]  # fmt: skip
        up, aside = max(margin - top, 0), max(margin - left, 0)
        seen = cover[up : up + part.shape[0], aside : aside + part.shape[1]]
        _light(part, 1.0 + seen)

    def light(self, factor: npt.NDArray[np.float32]) -> None:
        """Multiply the brightness."""
        _light(self.texture, factor)

    def corners(self, least: float = 0.72, reach: float = 0.5) -> None:
        """Darken towards the edges."""
        height, width = self.texture.shape[:2]
        rows, columns = height // _COARSE, width // _COARSE
        y = np.linspace(0.0, height / _SCALE, rows, dtype=np.float32)[:, None]
        x = np.linspace(0.0, width / _SCALE, columns, dtype=np.float32)
        edge = np.minimum(np.minimum(x, x[::-1]), np.minimum(y, y[::-1]))
        light = least + (1 - least) * (1 - np.exp(-edge / (0.5 * reach)))
        self.light(cv2.resize(light, (width, height)))

    def picture(self, x: float, y: float, width: float, height: float, hue: Colour) -> None:
        """Paint a framed landscape."""
        self.shade(x + 0.03, y + 0.04, width, height, 0.72)
        self.box(x, y, width, height, (70, 82, 96))
        self.box(x + 0.025, y + 0.025, width - 0.05, height - 0.05, (240, 242, 244))
        left, top, w, h = x + 0.07, y + 0.07, width - 0.14, height - 0.14
        self.box(left, top, w, h, shaded(hue, 1.35))
        self.disc(left + 0.68 * w, top + 0.3 * h, 0.09 * h, 0.09 * h, (190, 225, 245))
        for k, tone in enumerate((1.0, 0.8, 0.6)):
            self.box(left, top + (0.48 + 0.17 * k) * h, w, (0.52 - 0.17 * k) * h, shaded(hue, tone))


def _light(part: Texture, factor: npt.NDArray[Any]) -> None:
    light = np.broadcast_to(factor, part.shape[:2]).astype(np.float32)
    part[:] = cv2.multiply(part, cv2.merge([*[light] * 3, np.ones_like(light)]), dtype=cv2.CV_8U)


def _wall(width: float, colour: Colour, rng: np.random.Generator) -> Texture:
    surface = _plaster(width, colour, rng)
    surface.picture(1.3, 0.75, 0.9, 0.65, (150, 140, 110))
    surface.picture(2.7, 0.8, 0.5, 0.6, (110, 130, 150))
    surface.corners()
    return surface.texture


def _plaster(width: float, colour: Colour, rng: np.random.Generator) -> _Surface:
    """Return a wall with a skirting board and slight variations of brightness."""
    surface = _Surface(width, _Z1 - _Z0, colour)
    height, across = surface.texture.shape[:2]
    cloud = cv2.resize(rng.normal(0.0, 0.012, (5, 8)).astype(np.float32), (across, height))
    surface.light(1.0 + cloud)
    surface.box(0, _Z1 - _Z0 - 0.1, width, 0.1, _WHITE)
    surface.box(0, _Z1 - _Z0 - 0.108, width, 0.008, shaded(_WHITE, 0.7))
    return surface


def _front(rng: np.random.Generator) -> Texture:
    """Return the wall with a window."""
    surface = _plaster(_Y1 - _Y0, (206, 214, 218), rng)
    x, y, w, h = 0.55, 0.45, 1.5, 1.15
    surface.shade(x - 0.5, y - 0.3, w + 1.0, h + 0.7, 1.12)
    surface.box(x - 0.08, y - 0.08, w + 0.16, h + 0.16, _WHITE)
    for row in range(40):  # sky
        t = row / 40
        sky = (round(245 - 8 * t), round(214 + 26 * t), round(176 + 58 * t))
        surface.box(x, y + h * t, w, h / 40, sky)
    for k in range(9):  # trees far away
        surface.disc(x + w * k / 8, y + h * (0.83 + 0.04 * (k % 3)), 0.16, 0.2, (120, 150, 118))
    surface.box(x, y + 0.86 * h, w, 0.14 * h, (118, 160, 128))
    for part in (0.0, 0.5, 1.0):
        surface.box(x + part * w - 0.03, y, 0.06, h, _WHITE)
    surface.box(x, y + 0.32 * h, w, 0.045, _WHITE)
    surface.box(x - 0.14, y + h + 0.05, w + 0.28, 0.06, shaded(_WHITE, 1.02))
    surface.box(x - 0.14, y + h + 0.11, w + 0.28, 0.012, shaded(_WHITE, 0.7))
    surface.picture(2.75, 0.65, 0.75, 0.55, (150, 130, 80))
    surface.picture(3.75, 0.6, 0.5, 0.7, (100, 120, 160))
    surface.shade(2.7, 1.95, 1.7, 0.6, 0.7)
    surface.box(2.7, 1.75, 1.6, 0.72, _OAK)  # a sideboard
    for k in range(3):
        surface.box(2.73 + 0.525 * k, 1.79, 0.49, 0.64, shaded(_OAK, 1.1))
        surface.disc(2.73 + 0.525 * k + 0.245, 1.85, 0.015, 0.015, (70, 80, 90))
    surface.box(2.68, 1.72, 1.64, 0.04, shaded(_OAK, 1.2))
    surface.box(2.95, 1.5, 0.16, 0.22, (150, 130, 110))  # a vase
    for k in range(5):
        surface.disc(2.93 + 0.05 * k, 1.36 + 0.03 * (k % 2), 0.05, 0.13, (96, 140 - 8 * k, 92))
    surface.corners()
    return surface.texture


def _left(rng: np.random.Generator) -> Texture:
    """Return the wall with a bookshelf."""
    surface = _plaster(_X1 - _X0, (192, 206, 200), rng)
    x, y, w, h = 3.3, 0.5, 1.7, 2.0
    surface.shade(x - 0.05, y, w + 0.15, h + 0.1, 0.75)
    surface.box(x, y, w, h, shaded(_OAK, 0.9))
    for row in range(5):
        top = y + 0.04 + row * 0.392
        surface.box(x + 0.04, top, w - 0.08, 0.352, shaded(_OAK, 0.5))
        at = x + 0.05
        while at < x + w - 0.16 - 0.4 * float(rng.random()):
            wide, high = float(rng.uniform(0.025, 0.06)), float(rng.uniform(0.2, 0.31))
            colour = shaded(_BOOKS[rng.integers(len(_BOOKS))], float(rng.uniform(0.8, 1.25)))
            surface.box(at, top + 0.352 - high, wide - 0.004, high, colour)
            surface.box(at, top + 0.4 - high, wide - 0.004, 0.02, shaded(colour, 1.3))
            at += wide
    surface.picture(1.6, 0.7, 1.0, 0.7, (120, 140, 90))
    surface.corners()
    return surface.texture


def _right(rng: np.random.Generator) -> Texture:
    """Return the wall with a door."""
    surface = _plaster(_X1 - _X0, (202, 204, 212), rng)
    surface.box(1.1, 0.5, 1.04, 2.1, _WHITE)
    surface.box(1.17, 0.57, 0.9, 2.03, shaded(_WHITE, 0.93))
    for y, h in ((0.7, 0.7), (1.55, 0.9)):
        surface.box(1.3, y, 0.64, h, shaded(_WHITE, 0.86))
        surface.box(1.315, y + 0.02, 0.61, h - 0.035, shaded(_WHITE, 0.95))
    surface.box(1.22, 1.5, 0.12, 0.02, (120, 125, 130))
    surface.picture(2.9, 0.7, 0.65, 0.85, (150, 120, 110))
    surface.picture(3.8, 0.8, 0.8, 0.6, (90, 120, 140))
    surface.corners()
    return surface.texture


def _floor(rng: np.random.Generator) -> Texture:
    """Return oak planks and a carpet, lit by the window."""
    surface = _Surface(_Y1 - _Y0, _X1 - _X0, (98, 128, 158))
    _planks(surface, 0.16, 1.3, (104, 134, 162), rng)
    surface.shade(0.9, 1.2, 3.2, 2.2, 0.85)
    surface.box(1.0, 1.2, 3.0, 2.0, (150, 140, 128))
    surface.box(1.08, 1.28, 2.84, 1.84, (168, 164, 158))
    surface.box(1.2, 1.4, 2.6, 1.6, (176, 172, 166))
    surface.shade(0.7, 0.3, 0.65, 1.5, 1.28)
    surface.shade(1.45, 0.3, 0.65, 1.5, 1.28)
    surface.corners(0.6, 0.8)
    return surface.texture


def _planks(
    surface: _Surface, width: float, length: float, colour: Colour, rng: np.random.Generator
) -> None:
    height, across = (size / _SCALE for size in surface.texture.shape[:2])
    for k in range(int(across / width) + 1):
        y = -length * float(rng.random())
        while y < height:
            tone = shaded(colour, float(rng.uniform(0.92, 1.06)))
            surface.box(k * width, y, width - 0.006, length - 0.006, tone)
            y += length
    grain = rng.normal(1.0, 0.05, (12, round(across * _SCALE / 2))).astype(np.float32)
    surface.light(cv2.resize(grain, surface.texture.shape[1::-1], interpolation=cv2.INTER_CUBIC))


def _ceiling() -> Texture:
    surface = _Surface(_Y1 - _Y0, _X1 - _X0, (234, 236, 238))
    surface.shade(1.9, 1.6, 1.2, 1.2, 1.06)
    surface.disc(2.5, 2.2, 0.22, 0.22, (252, 253, 254))
    surface.corners(0.8, 1.0)
    return surface.texture


def _table(rng: np.random.Generator) -> Texture:
    surface = _Surface(1.4, 0.8, _OAK)
    _planks(surface, 0.14, 3.0, shaded(_OAK, 1.15), rng)
    return surface.texture
