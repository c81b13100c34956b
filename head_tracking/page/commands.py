"""The commands of the page: what a request asks of the robot, by its fields from JSON."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.head_modes import Mode
from head_tracking.page.live import Live
from head_tracking.page.path import path_ahead
from head_tracking.page.robot import Robot
from head_tracking.page.tuning import Tuning, finite
from head_tracking.tracking import Target

Fields = dict[str, Any]

_END = 2**31 * 10**9  # ns: later stamps fit in no message


def commands(robot: Robot, live: Live, tuning: Tuning) -> dict[str, Callable[[Fields], str | None]]:
    """Return the commands by name; for any thread. They return a text for the user, or None.

    A command raises ArithmeticError, LookupError, TypeError or ValueError if its fields are wrong,
    and HeadTrackingError if it is not carried out. Its field `stops` is the number of STOPs that
    the browser knew (default: 0); after another STOP the command is refused, unless it switches
    something off.
    """
    modes, joints, recorder = robot.modes, robot.joints, robot.recorder

    def in_time(command: Callable[[Fields], str | None], of: Fields) -> str | None:
        if of.get("mode") != Mode.OFF and of.get("on") is not False:
            robot.stop.require(of.get("stops", 0))
        return command(of)

    found: dict[str, Callable[[Fields], str | None]] = {
        "mode": lambda of: modes.set_mode(Mode(str(of["mode"])), str(of.get("frame", ""))),
        "select": lambda of: modes.select(_seen(of)),
        "look": lambda of: _look(robot, live, of),
        "path": lambda of: _follow_path(robot, of),
        "aim": lambda of: joints.move(_positions(of)),
        "centre": lambda _: modes.centre(),
        "torque": lambda of: joints.set_torque(str(of.get("controller", "")), _on(of)),
        "recover": lambda _: joints.recover(),
        "set": lambda of: tuning.set(str(of["node"]), str(of["name"]), of["value"]),
        "reset": lambda _: tuning.reset(),
        "preset": lambda of: tuning.choose(str(of["name"])),
        "record": lambda of: recorder.start() if _on(of) else recorder.stop(),
        "calibrate": lambda of: live.calibration.begin(float(of["size"]), str(of.get("topic", ""))),
    }
    return {name: partial(in_time, command) for name, command in found.items()}


def _positions(of: Fields) -> dict[str, float]:
    """Return the positions of one or more joints [rad or m]; raise ValueError for none."""
    positions = {str(name): finite(value) for name, value in dict(of["joints"]).items()}
    if not positions:
        raise ValueError("joints is empty: give one or more.")
    return positions


def _seen(of: Fields) -> Target:
    """Return what a camera has seen."""
    x, y, z = map(finite, of["point"])
    stamp = int(of["stamp"])
    if not 0 <= stamp < _END:
        raise ValueError(f"stamp must be from 0 to {_END - 1} ns, not {stamp}.")
    return Target(stamp, str(of["frame_id"]), (x, y, z))


def _on(of: Fields) -> bool:
    """Return a switch of a request; raise ValueError if it is neither true nor false."""
    if not isinstance(of["on"], bool):
        raise ValueError(f"on must be true or false, not {of['on']!r}.")
    return of["on"]


def _look(robot: Robot, live: Live, of: Fields) -> None:
    """Look at a point of a frame, or at a place in the picture."""
    model = robot.model()
    if model is None:
        raise HeadTrackingError("No robot description has been received.")
    frame = model.root
    if "point" in of:
        x, y, z = map(finite, of["point"])
        frame = str(of.get("frame") or frame)
    else:
        u, v = (_between(of, name, 0.0, 1.0) for name in ("u", "v"))
        stamp = None if of.get("stamp") is None else int(of["stamp"])
        x, y, z = live.point_at(u, v, stamp, str(of.get("topic", "")))
    robot.modes.look_at(frame, (x, y, z))


def _follow_path(robot: Robot, of: Fields) -> None:
    """Look along a shape before the camera."""
    speed = _between(of, "speed", 0.001, 10.0)
    model, head = robot.model(), robot.head
    if model is None or head is None:
        raise HeadTrackingError("The robot has no head for which to make a path.")
    path = path_ahead(model, head, str(of["shape"]), _between(of, "size", 0.001, 10.0))
    robot.modes.follow_path(path, speed)


def _between(of: Fields, name: str, low: float, high: float) -> float:
    """Return a number of a request; raise ValueError if it is out of range."""
    number = float(of[name])
    if not low <= number <= high:
        raise ValueError(f"{name} is {number}; allowed is {low:g} to {high:g}.")
    return number
