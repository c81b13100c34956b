"""Scenes of the simulated camera, with the robot at the origin."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from head_tracking.scene.drawings import Texture, marker, pattern, picture
from head_tracking.scene.objects import Ball, Board, Path, Scene, Swing, Thing
from head_tracking.scene.room import bench, room
from head_tracking.transforms import Vector3

MARKER_SIZE = 0.16
"""Edge of the black square of a marker [m]."""

ORANGE = (20, 110, 245)
MAGENTA = (200, 80, 230)

TARGET = "target"
"""The empty scene with a ball at the target."""

FACE_WIDTH = 0.24
"""Width of the box of a face detector around the face of a person [m]."""

_PERSON_WIDTH = 0.72
"""Width of the picture of a person [m]."""

_FACE_CENTRE = (0.508, 0.1105)
"""Middle of the face for a face detector, relative to the picture of a person."""

_PACE = 0.55  # s: one stride
_GLANCE = 7.0  # s: period of the head motion of a person who sits


def stride(person: str) -> list[Texture]:
    """Return the pictures of a person's stride; in the first one the person stands."""
    return [picture(f"{person}_{pose}.png") for pose in ("stands", "left", "stands", "right")]


def face(path: Path, pictures: Sequence[Texture] = ()) -> Board:
    """Return a person who stands or walks and faces the robot.

    Args:
        path: path of the middle of the face.
        pictures: a stride, as of `stride`; empty: that of a person in blue.
    """
    shown = pictures or stride("walker")

    def image(time: float) -> Texture:
        stands = math.dist(path(time), path(time + 0.1)) < 0.015
        return shown[0 if stands else int(time / _PACE * len(shown)) % len(shown)]

    return Board(image, _PERSON_WIDTH, path, _FACE_CENTRE)


def sitter(place: Vector3) -> Board:
    """Return a person on a chair, who turns the head from time to time."""

    def image(time: float) -> Texture:
        glance = time % _GLANCE
        turn = "ahead" if glance % 3.5 >= 1.2 else "right" if glance < 3.5 else "left"
        return picture(f"sitter_{turn}.png")

    return Board(image, _PERSON_WIDTH, lambda time: place, _FACE_CENTRE)


def marker_board(path: Path, number: int = 7, dictionary: str = "4X4_50") -> Board:
    """Return a marker on a white board."""
    texture = marker(dictionary, number)
    bits = {"4X4_50": 4, "APRILTAG_36h11": 6}[dictionary]
    return Board(texture, MARKER_SIZE * (bits + 4) / (bits + 2), path)


def _moving(distance: float = 1.5, bob: float = 0.06, **swing: float) -> Swing:
    return Swing(distance, 0.62, amplitude=0.5, frequency=0.2, bob=bob, **swing)


def _rolling(distance: float, height: float, frequency: float) -> dict[str, Thing]:
    """Return a ball that rolls on a bench, with its middle at a height [m]."""

    def path(time: float) -> Vector3:
        return distance, 0.5 * distance * math.sin(math.tau * frequency * time), height

    return {**bench(distance, height - 0.08), "ball": Ball(0.08, ORANGE, path)}


def _people(distance: float, **swing: float) -> dict[str, Thing]:
    """Return a person who walks, one who crosses behind, and one who sits beside the first view."""
    return {
        "face": face(_moving(distance)),
        "second face": face(_moving(distance + 0.7, bob=0.0, **swing), stride("tall_walker")),
        "third face": sitter((2.7, -1.9, 0.3)),
    }


STILL: Final = (1.5, 0.2, 0.7)
"""Where the marker and the face are that stand still [m]."""

_THINGS: Mapping[str, Callable[[np.random.Generator], dict[str, Thing]]] = {
    "empty": lambda rng: {},
    TARGET: lambda rng: {},
    "face": lambda rng: {"face": face(_moving())},
    "faces": lambda rng: _people(1.5, phase=np.pi),
    "ball": lambda rng: {"ball": Ball(0.08, ORANGE, _moving())},
    "marker": lambda rng: {"marker": marker_board(_moving())},
    "still marker": lambda rng: {"marker": marker_board(lambda _: STILL)},
    "still face": lambda rng: {"face": face(lambda _: STILL)},
    "picture": lambda rng: {"picture": Board(pattern(rng), 0.35, _moving())},
    "everything": lambda rng: {
        **_people(1.9, phase=2.0),
        **_rolling(1.3, 0.3, 0.15),
        "marker": marker_board(lambda _: (3.4, 0.1, 1.15)),
        "picture": Board(pattern(rng), 0.3, lambda _: (3.4, 0.08, 0.75)),
    },
}

SCENES = tuple(_THINGS)
"""Names of the scenes."""


def make_scene(name: str, rng: np.random.Generator) -> Scene:
    """Return a scene by its name, in a room."""
    return {**room(), **_THINGS[name](rng)}


def with_target(scene: Scene, point: Vector3) -> Scene:
    """Return a scene with a ball at the target [m]."""
    return {**scene, "target": Ball(0.06, MAGENTA, lambda _: point)}
