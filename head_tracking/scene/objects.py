"""Objects of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from head_tracking.scene.drawings import Colour, Texture, ball
from head_tracking.transforms import Vector3

Path: TypeAlias = Callable[[float], Vector3]
"""Returns a position [m] at a time [s]."""


@dataclass(frozen=True, slots=True)
class Swing:
    """An oscillation around the vertical axis through the origin.

    Attributes:
        distance: distance from the axis [m].
        height: height above the origin [m].
        amplitude: amplitude of the azimuth [rad].
        frequency: [Hz].
        phase: [rad].
        middle: mean azimuth [rad].
        bob: amplitude of the height, at twice the frequency [m].
    """

    distance: float
    height: float
    amplitude: float = 0.0
    frequency: float = 0.2
    phase: float = 0.0
    middle: float = 0.0
    bob: float = 0.0

    def __call__(self, time: float) -> Vector3:
        """Return the position [m] at a time [s]."""
        turn = math.tau * self.frequency * time + self.phase
        azimuth = self.middle + self.amplitude * math.sin(turn)
        return (
            self.distance * math.cos(azimuth),
            self.distance * math.sin(azimuth),
            self.height + self.bob * math.sin(2 * turn),
        )


@dataclass(frozen=True, slots=True)
class Ball:
    """A matt ball.

    Attributes:
        radius: [m].
        colour: blue, green, red.
        path: path of the middle.
    """

    radius: float
    colour: Colour
    path: Path

    def image(self, time: float) -> Texture:
        """Return how it looks from everywhere, at any time."""
        return ball(self.colour)


@dataclass(frozen=True, slots=True)
class Board:
    """A flat image that always faces the axis of the scene.

    Attributes:
        texture: the image, or a function that returns it at a time [s]; alpha 0 is transparent.
        width: [m].
        path: path of the anchor.
        anchor: point of the image that follows the path, relative to width and height.
    """

    texture: Texture | Callable[[float], Texture]
    width: float
    path: Path
    anchor: tuple[float, float] = (0.5, 0.5)

    def image(self, time: float) -> Texture:
        """Return the image at a time [s]."""
        return self.texture(time) if callable(self.texture) else self.texture


@dataclass(frozen=True, slots=True)
class Panel:
    """A flat image at rest.

    Attributes:
        texture: the image.
        corner: upper left corner [m].
        right: vector to the upper right corner [m].
        down: vector to the lower left corner [m].
    """

    texture: Texture
    corner: Vector3
    right: Vector3
    down: Vector3

    def image(self, time: float) -> Texture:
        """Return the image at a time [s]."""
        return self.texture


@dataclass(frozen=True, slots=True)
class Wall(Panel):
    """A side of a convex room that contains all other objects."""


Thing: TypeAlias = Ball | Board | Panel

Scene: TypeAlias = dict[str, Thing]
"""Objects by name, in a frame with z up."""
