"""Textures of people, from the front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from head_tracking.scene.drawings import Colour, Texture, shaded
from head_tracking.vision.opencv import cv2

_SCALE = 600  # pixels per metre
_UP, _DOWN, _HALF = 0.19, 1.53, 0.36  # m: edges of the texture around the middle of the face

PERSON_WIDTH = 2 * _HALF
"""Width of the texture of a person [m]."""

FACE_CENTRE = (0.5, _UP / (_UP + _DOWN))
"""Middle of the face for a face detector, relative to the texture."""

FACE_WIDTH = 0.24
"""Width of the box of a face detector around the face [m]."""

STEPS = 4
"""Number of textures of a stride."""

_COARSE = 4.0  # pixels of the coarse shading in its width

_CHAIR = (70, 96, 122)

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Looks:
    """Appearance of a person; colours are blue, green, red."""

    skin: Colour = (150, 180, 225)
    hair: Colour = (35, 45, 70)
    shirt: Colour = (150, 80, 40)
    trousers: Colour = (80, 62, 52)
    long_hair: bool = False


@lru_cache(maxsize=64)
def person(looks: Looks, step: int | None = None, turn: float = 0.0, sits: bool = False) -> Texture:
    """Return the texture of a person.

    Args:
        looks: the appearance.
        step: phase of the stride, below `STEPS`; None: the person stands.
        turn: rotation of the head to the right of the image, -1 to 1.
        sits: whether the person sits.
    """
    draw = _Painter()
    swing = 0.0 if step is None else math.sin(math.tau * step / STEPS)
    _legs(draw, looks, swing, sits)
    _body(draw, looks, swing, sits)
    _head(draw, looks, 0.022 * turn)
    return draw.picture


class _Painter:
    """Paints shaded shapes; positions are relative to the middle of the face [m]."""

    def __init__(self) -> None:
        size = round((_UP + _DOWN) * _SCALE), round(2 * _HALF * _SCALE)
        self.picture: Texture = np.zeros((*size, 4), np.uint8)

    def ellipse(self, x: float, y: float, a: float, b: float, colour: Colour, soft: float) -> None:
        """Paint an ellipse with semi-axes a, b."""
        angles = np.linspace(0.0, math.tau, 48, endpoint=False)
        self.shape([(x + a * math.cos(t), y + b * math.sin(t)) for t in angles], colour, soft)

    def limb(self, points: Points, widths: Sequence[float], colour: Colour) -> None:
        """Paint a limb along points, with its half width at each point."""
        along = np.gradient(np.array(points), axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        aside = along[:, ::-1] * (1, -1) * np.array(widths)[:, None]
        self.shape([*(points + aside), *(points - aside)[::-1]], colour, 0.035)

    def shape(self, points: Points, colour: Colour, soft: float = 0.0) -> None:
        """Paint a polygon; soft: width of the shading at its edge [m]."""
        outline = (np.array(points) + np.array([_HALF, _UP])) * _SCALE
        margin = round(2 * soft * _SCALE) + 2
        left, top = np.maximum(outline.min(axis=0).astype(int) - margin, 0)
        right, bottom = outline.max(axis=0).astype(int) + margin
        part = self.picture[top:bottom, left:right]
        cover = np.zeros(part.shape[:2], np.uint8)
        fixed = np.round((outline - (left, top)) * 16).astype(np.int32)
        cv2.fillPoly(cover, [fixed], 255, cv2.LINE_AA, 4)
        share = cover.astype(np.float32) / np.float32(255)
        light = _shading(share, soft * _SCALE) if soft else np.ones_like(share)
        painted = cv2.multiply(cv2.merge([light] * 4), (*colour, 0), dtype=cv2.CV_8U)
        alpha = np.maximum(part[..., 3], cover)
        part[:] = cv2.blendLinear(part, painted, 1 - share, share)
        part[..., 3] = alpha


def _shading(cover: npt.NDArray[np.float32], width: float) -> npt.NDArray[np.float32]:
    """Return the brightness of a rounded shape, lit from the upper left.

    Args:
        cover: coverage of the pixels by the shape.
        width: width of the shading at the edge [pixels].
    """
    # the shading is smooth: a coarse one is enough
    reduced = max(1, int(width / _COARSE))
    size = cover.shape[1] // reduced + 1, cover.shape[0] // reduced + 1
    bulge = cv2.GaussianBlur(
        cv2.resize(cover, size, interpolation=cv2.INTER_AREA), (0, 0), width / reduced
    )
    slope = width / reduced * (cv2.Sobel(bulge, -1, 1, 0) + cv2.Sobel(bulge, -1, 0, 1)) / 8
    light = np.clip(1.0 + 0.45 * slope + 0.25 * (bulge - 0.8), 0.5, 1.25)
    return np.asarray(cv2.resize(light, cover.shape[::-1]), np.float32)


def _legs(draw: _Painter, looks: Looks, swing: float, sits: bool) -> None:
    shoe = (40, 42, 48)
    if sits:
        for side in (-1, 1):
            draw.limb([(0.21 * side, 0.7), (0.22 * side, 1.24)], [0.018, 0.016], _CHAIR)
        draw.shape([(-0.25, 0.25), (0.25, 0.25), (0.24, 0.78), (-0.24, 0.78)], _CHAIR, 0.02)
    for side in (-1, 1):
        lift = max(0.0, side * swing)
        foot = 1.2 if sits else 1.48 - 0.07 * lift
        hip, knee = (0.08 * side, 0.6), (0.09 * side, 1.06 - 0.05 * lift)
        if sits:
            hip, knee = (0.085 * side, 0.6), (0.13 * side, 0.8)
        draw.ellipse(0.1 * side, foot + 0.01, 0.05, 0.035, shoe, 0.02)
        ankle = (0.095 * side, foot - 0.01)
        draw.limb([hip, knee, ankle], [0.093, 0.07, 0.047], looks.trousers)


def _body(draw: _Painter, looks: Looks, swing: float, sits: bool) -> None:
    shirt, skin = looks.shirt, looks.skin
    for side in (-1, 1):
        forward = -side * swing  # an arm moves with the opposite leg
        elbow = (0.245 * side, 0.47 - 0.02 * forward)
        hand = (0.24 * side - 0.03 * side * max(0.0, forward), 0.69 - 0.05 * max(0.0, forward))
        if sits:
            hand = (0.13 * side, 0.66)
        draw.ellipse(hand[0], hand[1] + 0.035, 0.034, 0.05, skin, 0.015)
        shoulder = (0.18 * side, 0.212)
        draw.ellipse(*shoulder, 0.05, 0.045, shirt, 0.03)
        draw.limb([shoulder, elbow, hand], [0.05, 0.05, 0.036], shaded(shirt, 0.93))
    if looks.long_hair:
        draw.ellipse(0.0, 0.09, 0.118, 0.17, shaded(looks.hair, 0.8), 0.03)
    torso = [
        (-0.05, 0.12), (-0.13, 0.145), (-0.19, 0.165), (-0.222, 0.2), (-0.2, 0.33), (-0.172, 0.46),
        (-0.172, 0.62), (-0.165, 0.66), (0.165, 0.66), (0.172, 0.62), (0.172, 0.46), (0.2, 0.33),
        (0.222, 0.2), (0.19, 0.165), (0.13, 0.145), (0.05, 0.12),
    ]  # fmt: skip
    draw.shape(torso, shirt, 0.05)
    draw.limb([(0.0, 0.06), (0.0, 0.15)], [0.048, 0.053], shaded(skin, 0.78))
    draw.shape([(-0.055, 0.12), (0.055, 0.12), (0.0, 0.2)], shaded(skin, 0.85), 0.02)
    for side in (-1, 1):
        collar = [(0.047 * side, 0.105), (0.088 * side, 0.135), (0.008 * side, 0.205)]
        draw.shape(collar, shaded(shirt, 1.15), 0.01)
    for y in (0.27, 0.36, 0.45, 0.54):
        draw.ellipse(0.0, y, 0.006, 0.006, shaded(shirt, 1.35), 0.0)


def _head(draw: _Painter, looks: Looks, turn: float) -> None:
    """Paint the head; turn: offset of the face to the right [m]."""
    skin, hair = looks.skin, looks.hair
    draw.ellipse(0.0, -0.042, 0.1, 0.122, hair, 0.03)
    for side in (-1, 1):
        draw.ellipse(0.089 * side - 0.3 * turn, -0.008, 0.014, 0.026, shaded(skin, 0.85), 0.01)
    jaw = [(0.086 * math.cos(t), 0.1 * math.sin(t)) for t in np.linspace(0, math.pi, 24)]
    skull = [(0.086 * math.cos(t), 0.112 * math.sin(t)) for t in np.linspace(math.pi, math.tau, 24)]
    draw.shape([(x, y - 0.012) for x, y in jaw + skull], skin, 0.045)
    for side in (-1, 1):
        x = (0.0375 - 0.15 * abs(turn)) * side + turn
        draw.ellipse(x, -0.033, 0.029, 0.017, shaded(skin, 0.8), 0.012)
        draw.ellipse(x + 0.008 * side, 0.022, 0.022, 0.016, shaded(skin, 1.02), 0.016)
        draw.ellipse(x, -0.0555, 0.027, 0.0062, shaded(hair, 0.8), 0.0)
        draw.ellipse(x, -0.031, 0.0185, 0.0098, (238, 240, 242), 0.0)
        draw.ellipse(x + 0.2 * turn, -0.031, 0.0095, 0.0095, (50, 62, 70), 0.0)
        draw.ellipse(x + 0.2 * turn, -0.031, 0.0048, 0.0048, (18, 16, 16), 0.0)
        draw.ellipse(x - 0.003, -0.0345, 0.0022, 0.0022, (250, 250, 250), 0.0)
    nose = 1.25 * turn
    draw.ellipse(nose, -0.002, 0.0125, 0.03, shaded(skin, 1.1), 0.012)
    draw.ellipse(nose, 0.0225, 0.018, 0.0085, shaded(skin, 0.72), 0.008)
    smile = np.linspace(-1.0, 1.0, 12)
    upper = [(0.034 * s + turn, 0.057 - 0.009 * s * s) for s in smile]
    lower = [(0.034 * s + turn, 0.070 - 0.022 * s * s) for s in smile[::-1]]
    draw.shape(upper + lower, (92, 84, 172), 0.004)
    draw.shape(
        [(x, y + 0.003) for x, y in upper] + [(x, y - 0.006) for x, y in lower], (60, 50, 110), 0.0
    )
    fringe = [
        (0.091 * math.cos(t), -0.06 + 0.098 * math.sin(t))
        for t in np.linspace(math.pi, math.tau, 24)
    ]
    draw.shape([*fringe, (0.075, -0.075), (0.02, -0.088), (-0.045, -0.079)], hair, 0.02)
    if looks.long_hair:
        for side in (-1, 1):
            draw.limb(
                [(0.082 * side, -0.1), (0.099 * side, -0.02), (0.1 * side, 0.13)],
                [0.012, 0.014, 0.026],
                hair,
            )
