"""The room of a scene. Its sides are pictures: 220 pixels per metre, lit by the window."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from head_tracking.scene.drawings import Texture
from head_tracking.scene.objects import Panel, Thing, Wall
from head_tracking.vision.opencv import cv2

_X0, _X1, _Y0, _Y1, _Z0, _Z1 = -2.5, 3.5, -2.5, 2.5, -0.9, 1.7
"""Sides of the room [m]; the robot stands on a table."""

_PICTURES = Path(__file__).with_name("pictures")


def room() -> dict[str, Thing]:
    """Return four walls, a floor and a ceiling, 6 m by 5 m, and the table under the robot."""
    up, x, y = _Z1 - _Z0, _X1 - _X0, _Y1 - _Y0
    return {
        "front": Wall(_picture("front"), (_X1, _Y1, _Z1), (0, -y, 0), (0, 0, -up)),
        "left": Wall(_picture("left"), (_X0, _Y1, _Z1), (x, 0, 0), (0, 0, -up)),
        "right": Wall(_picture("right"), (_X1, _Y0, _Z1), (-x, 0, 0), (0, 0, -up)),
        "back": Wall(_picture("back"), (_X0, _Y0, _Z1), (0, y, 0), (0, 0, -up)),
        "floor": Wall(_picture("floor"), (_X1, _Y1, _Z0), (0, -y, 0), (-x, 0, 0)),
        "ceiling": Wall(_picture("ceiling"), (_X0, _Y1, _Z1), (0, -y, 0), (x, 0, 0)),
        "table": Panel(_picture("table"), (0.45, 0.7, -0.01), (0, -1.4, 0), (-0.8, 0, 0)),
    }


def bench(distance: float, height: float) -> dict[str, Thing]:
    """Return a white bench in front of the robot.

    Args:
        distance: distance of its middle [m].
        height: height of its top [m].
    """
    x, front, top = distance - 0.15, _picture("bench_front"), _picture("bench_top")
    return {
        "bench front": Panel(front, (x, 1.0, height), (0, -2.0, 0), (0, 0, _Z0 - height)),
        "bench top": Panel(top, (x + 0.3, 1.0, height), (0, -2.0, 0), (-0.3, 0, 0)),
    }


@cache
def _picture(name: str) -> Texture:
    picture = cv2.imread(str(_PICTURES / f"{name}.jpg"))
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2BGRA))
