"""The room of a scene. Its sides are pictures: 220 pixels per metre, lit by the window."""

from __future__ import annotations

from head_tracking.scene.drawings import picture
from head_tracking.scene.objects import Panel, Thing, Wall

_X0, _X1, _Y0, _Y1, _Z0, _Z1 = -2.5, 3.5, -2.5, 2.5, -0.9, 1.7
"""Sides of the room [m]; the robot stands on a table."""


def room() -> dict[str, Thing]:
    """Return four walls, a floor and a ceiling, 6 m by 5 m, and the table under the robot."""
    up, x, y = _Z1 - _Z0, _X1 - _X0, _Y1 - _Y0
    return {
        "front": Wall(picture("front.jpg"), (_X1, _Y1, _Z1), (0, -y, 0), (0, 0, -up)),
        "left": Wall(picture("left.jpg"), (_X0, _Y1, _Z1), (x, 0, 0), (0, 0, -up)),
        "right": Wall(picture("right.jpg"), (_X1, _Y0, _Z1), (-x, 0, 0), (0, 0, -up)),
        "back": Wall(picture("back.jpg"), (_X0, _Y0, _Z1), (0, y, 0), (0, 0, -up)),
        "floor": Wall(picture("floor.jpg"), (_X1, _Y1, _Z0), (0, -y, 0), (-x, 0, 0)),
        "ceiling": Wall(picture("ceiling.jpg"), (_X0, _Y1, _Z1), (0, -y, 0), (x, 0, 0)),
        "table": Panel(picture("table.jpg"), (0.45, 0.7, -0.01), (0, -1.4, 0), (-0.8, 0, 0)),
    }


def bench(distance: float, height: float) -> dict[str, Thing]:
    """Return a white bench in front of the robot.

    Args:
        distance: distance of its middle [m].
        height: height of its top [m].
    """
    x, front, top = distance - 0.15, picture("bench_front.jpg"), picture("bench_top.jpg")
    return {
        "bench front": Panel(front, (x, 1.0, height), (0, -2.0, 0), (0, 0, _Z0 - height)),
        "bench top": Panel(top, (x + 0.3, 1.0, height), (0, -2.0, 0), (-0.3, 0, 0)),
    }
