"""The commands of the page: what a request asks of the robot, from JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from head_tracking.page.head_modes import CAMERA, Mode
from head_tracking.page.live import Live
from head_tracking.page.path import Path, path_ahead
from head_tracking.page.robot import Robot
from head_tracking.page.tuning import Tuning
from head_tracking.ros.kit.other_services import Outcome

Command = Callable[[dict[str, Any]], Outcome]


class Commands:
    """Asks a robot for what browsers want; for any thread.

    A command raises ArithmeticError, LookupError, TypeError or ValueError if its fields are wrong.

    Args:
        robot: is steered.
        live: knows what the browsers show.
        tuning: of the parameters.

    Attributes:
        by_name: the commands.
    """

    def __init__(self, robot: Robot, live: Live, tuning: Tuning) -> None:
        self._robot, self._live = robot, live
        self.by_name: Mapping[str, Command] = {
            "mode": lambda body: robot.modes.set_mode(
                Mode(str(body["mode"])), str(body.get("frame", ""))
            ),
            "look": self._look,
            "path": self._follow_path,
            "aim": self._aim,
            "centre": lambda _: robot.modes.centre(),
            "camera": lambda _: robot.modes.start(CAMERA),
            "torque": lambda body: robot.joints.set_torque(
                str(body.get("controller", "")), body["on"] is True
            ),
            "recover": lambda _: robot.joints.recover(),
            "set": lambda body: tuning.set(str(body["node"]), str(body["name"]), body["value"]),
            "reset": lambda _: tuning.reset(),
            "preset": lambda body: tuning.choose(str(body["name"])),
            "record": lambda body: (
                robot.recorder.start() if body["on"] is True else robot.recorder.stop()
            ),
            "calibrate": lambda body: live.calibration.begin(
                float(body["size"]), str(body.get("topic", ""))
            ),
        }

    def _look(self, body: dict[str, Any]) -> Outcome:
        """Look at a point of a frame, or at a place in the picture."""
        model, modes = self._robot.model(), self._robot.modes
        if model is None:
            return Outcome(False, "No robot description has been received.")
        frame = model.root
        if "point" in body:
            x, y, z = map(float, body["point"])
            frame = str(body.get("frame") or frame)
        else:
            u, v = (_number(body, name, 0.0, 1.0) for name in ("u", "v"))
            stamp = None if body.get("stamp") is None else int(body["stamp"])
            x, y, z = self._live.point_at(u, v, stamp, str(body.get("topic", "")))
        if body.get("take_over") and modes.mode() is Mode.OFF:
            mode = Mode.TRACK if Mode.TRACK in modes.possible() else Mode.POINT
            outcome = modes.set_mode(mode)
            if not outcome.done:
                return outcome
        return modes.look_at(frame, (x, y, z), wait=body.get("wait") is True)

    def _follow_path(self, body: dict[str, Any]) -> Outcome:
        """Look along a shape before the camera, or along points in the model's root."""
        speed = _number(body, "speed", 0.001, 10.0)
        if "points" in body:
            points = [(float(x), float(y), float(z)) for x, y, z in body["points"]]
            if not all(math.isfinite(value) for point in points for value in point):
                raise ValueError("The points must be finite numbers in metres.")
            return self._robot.modes.follow_path(Path(points), speed)
        model, head = self._robot.model(), self._robot.head()
        if model is None or head is None:
            return Outcome(False, "The robot has no head for which to make a path.")
        path = path_ahead(model, head, str(body["shape"]), _number(body, "size", 0.001, 10.0))
        return self._robot.modes.follow_path(path, speed)

    def _aim(self, body: dict[str, Any]) -> Outcome:
        positions = {str(name): float(value) for name, value in dict(body["joints"]).items()}
        if not all(map(math.isfinite, positions.values())):
            raise ValueError("Joint positions must be finite numbers in rad or m.")
        return self._robot.joints.move(positions)


def _number(body: dict[str, Any], name: str, low: float, high: float) -> float:
    """Return a number of a request.

    Raises:
        ValueError: it is not from `low` to `high`.
    """
    value = float(body[name])
    if not low <= value <= high:
        raise ValueError(f"{name} must be from {low:g} to {high:g}, not {value}.")
    return value
