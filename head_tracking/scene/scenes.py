"""The scenes that the simulated camera can show, around a robot at the origin."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from head_tracking.scene.drawings import Looks, marker, pattern, person, wall
from head_tracking.scene.objects import Ball, Board, Path, Scene, Swing, Thing, Wall
from head_tracking.transforms import Vector3

FACE_CENTRE = (0.5, 0.487)
"""Where a face detector sees the middle of a drawn face, as a share of its picture."""

PERSON_WIDTH = 0.36  # m, shoulder to shoulder of the picture
FACE_WIDTH = 0.667 * PERSON_WIDTH
"""Width [m] of the box that a face detector draws around such a face."""

MARKER_SIZE = 0.16
"""Edge of the black square of a marker [m]."""

ORANGE = (20, 110, 245)
MAGENTA = (200, 80, 230)

TARGET = "target"
"""The scene with nothing in it but a ball where the target is, once there is one."""

TALL_DARK = Looks(skin=(90, 120, 170), hair=(20, 20, 20), shirt=(60, 130, 40))


def face(path: Path, looks: Looks | None = None) -> Board:
    """A person who looks at the robot; the path is that of the face's middle."""
    return Board(person(looks or Looks()), PERSON_WIDTH, path, FACE_CENTRE)


def marker_board(path: Path, number: int = 7, dictionary: str = "4X4_50") -> Board:
    """A marker on a white board."""
    texture = marker(dictionary, number)
    bits = {"4X4_50": 4, "APRILTAG_36h11": 6}[dictionary]
    return Board(texture, MARKER_SIZE * (bits + 4) / (bits + 2), path)


def room(rng: np.random.Generator) -> dict[str, Thing]:
    """Four walls, a floor and a ceiling, 6 m by 5 m."""
    x0, x1, y0, y1, z0, z1 = -2.5, 3.5, -2.5, 2.5, 0.0, 2.6
    up, size_x, size_y = z1 - z0, x1 - x0, y1 - y0
    return {
        "front": Wall(wall((205, 212, 214), rng), (x1, y1, z1), (0, -size_y, 0), (0, 0, -up)),
        "left": Wall(wall((190, 205, 196), rng), (x0, y1, z1), (size_x, 0, 0), (0, 0, -up)),
        "right": Wall(wall((196, 190, 205), rng), (x1, y0, z1), (-size_x, 0, 0), (0, 0, -up)),
        "back": Wall(wall((185, 190, 200), rng), (x0, y0, z1), (0, size_y, 0), (0, 0, -up)),
        "floor": Wall(wall((95, 115, 135), rng), (x1, y1, z0), (0, -size_y, 0), (-size_x, 0, 0)),
        "ceiling": Wall(wall((235, 235, 235), rng), (x0, y1, z1), (0, -size_y, 0), (size_x, 0, 0)),
    }


def _moving(distance: float = 1.5, bob: float = 0.06, **swing: float) -> Swing:
    return Swing(distance, 0.62, amplitude=0.5, frequency=0.2, bob=bob, **swing)


_THINGS: Mapping[str, Callable[[np.random.Generator], dict[str, Thing]]] = {
    "empty": lambda rng: {},
    TARGET: lambda rng: {},
    "face": lambda rng: {"face": face(_moving())},
    "faces": lambda rng: {
        "face": face(_moving()),
        "second face": face(_moving(2.2, phase=np.pi, bob=0.0), TALL_DARK),
    },
    "ball": lambda rng: {"ball": Ball(0.08, ORANGE, _moving())},
    "marker": lambda rng: {"marker": marker_board(_moving())},
    "still marker": lambda rng: {"marker": marker_board(lambda _: (1.5, 0.2, 0.7))},
    "picture": lambda rng: {"picture": Board(pattern(rng), 0.35, _moving())},
    "everything": lambda rng: {
        "face": face(_moving(2.0)),
        "second face": face(_moving(2.4, phase=2.0, bob=0.0), TALL_DARK),
        "ball": Ball(0.08, ORANGE, Swing(1.3, 0.35, 0.5, 0.15, 1.0)),
        "marker": marker_board(Swing(1.8, 1.0, 0.3, 0.1, 2.0)),
        "picture": Board(pattern(rng), 0.3, Swing(1.7, 0.25, 0.2, 0.1, 4.0, -0.3)),
    },
}

SCENES = tuple(_THINGS)
"""Names of the scenes."""


def make_scene(name: str, rng: np.random.Generator) -> Scene:
    """A room with what its name says in it."""
    return Scene({**room(rng), **_THINGS[name](rng)})


def with_target(scene: Scene, point: Vector3) -> Scene:
    """The scene with a ball at the target [m]."""
    return Scene({**scene.things, "target": Ball(0.06, MAGENTA, lambda _: point)})
