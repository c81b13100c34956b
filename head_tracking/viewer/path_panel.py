"""A path to look along: its shape, size and speed, or points that a person adds."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from head_tracking.gaze import PanTiltHead
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.transforms import RobotModel, Rotation, Vector3
from head_tracking.viewer.head_modes import HeadModes, Mode
from head_tracking.viewer.notify import notify
from head_tracking.viewer.path import SHAPES, Path, shaped

_POINTS = "points of your own"
_AWAY = 1.0  # m from the camera
_COLOUR = (30, 140, 200)


class PathPanel:
    """Shape, size, speed, "Add point", "Clear points"; and the path in the scene.

    Args:
        server: gets the inputs, in the container that is open now.
        modes: lets the head look along the path.
        point: that the browser of an event has chosen, in the robot's root [m]; None: it is
            nowhere.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        modes: HeadModes,
        point: Callable[[viser.GuiEvent[Any]], Vector3 | None],
    ) -> None:
        gui = server.gui
        self._modes = modes
        self._point = point
        self._points: list[Vector3] = []
        self._place: tuple[Vector3, Vector3, Vector3] | None = None
        with gui.add_folder("Path", visible=False) as self._folder:
            self._shape = gui.add_dropdown("Shape", (*SHAPES, _POINTS))
            self._size = gui.add_slider(
                "Size (cm)", 5, 60, 1, 30, hint="Half of its width, 1 m before the camera."
            )
            self._speed = gui.add_slider(
                "Speed (cm/s)", 1, 100, 1, 25, hint="Along the path. 1 m away, 17 cm/s are 10°/s."
            )
            self._add = gui.add_button(
                "Add point", icon=viser.Icon.PLUS, visible=False,
                hint="Adds x y z, as above, to the path, which ends where it begins.",
            )  # fmt: skip
            self._clear = gui.add_button("Clear points", icon=viser.Icon.TRASH, visible=False)
        self._line = server.scene.add_line_segments(
            "/path", np.zeros((1, 2, 3), np.float32), _COLOUR, thickness=1.5,
            thickness_units="screen", visible=False,
        )  # fmt: skip
        for given in (self._shape, self._size, self._speed):
            given.on_update(lambda _: self._take())
        self._add.on_click(self._on_add)
        self._clear.on_click(self._on_clear)

    def set_head(self, model: RobotModel, head: PanTiltHead) -> None:
        """Puts shapes before the camera as it is with all joints at 0."""
        standing = dict.fromkeys(model.independent_joints, 0.0)
        camera = model.transform(model.root, head.pointing_frame, standing)
        ahead: Vector3 = camera.rotation @ head.pointing_axis
        turn = Rotation.from_rpy(0.0, 0.0, math.atan2(ahead[1], ahead[0]))
        x, y, z = (c + _AWAY * a for c, a in zip(camera.translation, ahead, strict=True))
        self._place = ((x, y, z), turn @ (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))
        self._take()

    def refresh(self) -> None:
        """Shows what the mode needs."""
        on = self._modes.mode() is Mode.PATH
        own = self._shape.value == _POINTS
        self._folder.visible = on
        self._size.visible, self._add.visible = not own, own
        self._clear.visible = own and bool(self._points)
        self._line.visible = on and self._modes.path is not None

    def legend(self) -> tuple[tuple[str, str], ...]:
        """What the line in the scene means, and its colour as in CSS; nothing if there is none."""
        return (("path", "#{:02x}{:02x}{:02x}".format(*_COLOUR)),) if self._line.visible else ()

    def _take(self) -> Outcome:
        """Hands the path over as it is wanted now."""
        try:
            path = self._path()
        except ValueError as error:
            self._modes.set_path(None, 0.0, str(error))
            return Outcome(False, str(error))
        ends = np.array([*path.points, path.points[0]], np.float32)
        self._line.points = np.stack([ends[:-1], ends[1:]], axis=1)
        self._modes.set_path(path, 0.01 * self._speed.value)
        return Outcome(True, f"the path has {len(path.points)} points")

    def _path(self) -> Path:
        if self._shape.value == _POINTS:
            return Path(self._points)
        if self._place is None:
            raise ValueError("no head is known to make a path before")
        return shaped(self._shape.value, *self._place, 0.01 * self._size.value)

    def _on_add(self, event: viser.GuiEvent[Any]) -> None:
        point = self._point(event)
        if point is None:
            notify(event, Outcome(False, "it is not known where that frame is"), "Path")
            return
        self._points.append(point)
        outcome = self._take()
        notify(event, Outcome(True, outcome.text), "Path")

    def _on_clear(self, _: viser.GuiEvent[Any]) -> None:
        self._points.clear()
        self._take()
