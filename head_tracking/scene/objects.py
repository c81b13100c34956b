"""What stands and moves before a simulated camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from head_tracking.scene.drawings import Colour, Texture
from head_tracking.transforms import Transform, Vector3

Path: TypeAlias = Callable[[float], Vector3]
"""Where something is [m] at a time [s]."""


@dataclass(frozen=True, slots=True)
class Swing:
    """A path to and fro around a vertical axis through the origin, as seen from a head.

    Attributes:
        distance: from the axis [m].
        height: above the origin [m].
        amplitude: of the azimuth [rad].
        frequency: [Hz].
        phase: [rad].
        middle: azimuth around which it swings [rad].
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
        """The point [m] at a time [s]."""
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
        path: of its middle.
    """

    radius: float
    colour: Colour
    path: Path


@dataclass(frozen=True, slots=True)
class Board:
    """A flat picture that always faces the axis of the scene, as people face a robot.

    Attributes:
        texture: what is on it, always or at a time [s]; where alpha is 0 one sees through. All
            have the same size.
        width: [m].
        path: of the anchor.
        anchor: the point of the picture that follows the path, as a share of its width and height.
    """

    texture: Texture | Callable[[float], Texture]
    width: float
    path: Path
    anchor: tuple[float, float] = (0.5, 0.5)

    def look(self, time: float) -> Texture:
        """What is on it at a time [s]."""
        return self.texture(time) if callable(self.texture) else self.texture


@dataclass(frozen=True, slots=True)
class Panel:
    """A flat picture that stands still.

    Attributes:
        texture: what is on it.
        corner: its upper left corner [m].
        right: from there to the upper right corner [m].
        down: from there to the lower left corner [m].
    """

    texture: Texture
    corner: Vector3
    right: Vector3
    down: Vector3

    def look(self, time: float) -> Texture:
        """What is on it at a time [s]."""
        return self.texture


@dataclass(frozen=True, slots=True)
class Wall(Panel):
    """A side of a room: all of them together enclose everything else, without dents."""


Thing: TypeAlias = Ball | Board | Panel


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that a camera may see, in a frame with z up.

    Attributes:
        things: by name.
    """

    things: dict[str, Thing]

    def position(self, name: str, time: float) -> Vector3:
        """Where a ball or the anchor of a board is [m]."""
        thing = self.things[name]
        assert isinstance(thing, Ball | Board), f"{name} stands still"
        return thing.path(time)

    def seen_surface(self, name: str, time: float, T_scene_optical: Transform) -> Vector3:
        """The point of a thing that a depth camera finds [m]: of a ball, the side it sees."""
        thing, position = self.things[name], self.position(name, time)
        if not isinstance(thing, Ball):
            return position
        camera = T_scene_optical.translation
        away = math.dist(camera, position)
        x, y, z = (p + (c - p) * thing.radius / away for p, c in zip(position, camera, strict=True))
        return x, y, z
