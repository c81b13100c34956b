"""What is drawn: parts of the scene, frames; and the camera's eye."""

from __future__ import annotations

from typing import Any

import viser

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation
from head_tracking.transforms import RobotModel
from head_tracking.viewer.camera_view import CameraView
from head_tracking.viewer.frames_scene import FramesScene
from head_tracking.viewer.gaze_scene import GazeScene, ViewParameters
from head_tracking.viewer.notify import follow
from head_tracking.viewer.robot import Robot

_NONE, _ALL = "none", "all frames"


class ViewPanel:
    """Checkboxes for parts, a menu of frames, a button for the camera's view."""

    def __init__(self, server: viser.ViserServer, robot: Robot, view: ViewParameters) -> None:
        self._gui = server.gui
        self._buffer = robot.buffer
        self._gaze: GazeScene | None = None
        self._frames_scene: FramesScene | None = None
        self._parts: dict[str, Any] = {}
        self._frames = self._gui.add_dropdown(
            "Frames", [_NONE, _ALL], hint="Draws the axes of frames, each with its name."
        )
        self._box = self._gui.add_folder(None)
        self._camera = CameraView(server, view)

    def set_scenes(self, gaze: GazeScene, frames: FramesScene) -> None:
        """What is switched on and off."""
        self._gaze, self._frames_scene = gaze, frames
        for part, box in self._parts.items():
            gaze.want(part, box.value)

    def set_head(self, model: RobotModel, head: PanTiltHead) -> None:
        """A head is known, and with it more parts."""
        self._camera.set_head(model, head)
        if self._gaze is None:
            return
        for part in self._gaze.parts:
            if part not in self._parts:
                self._parts[part] = self._checkbox(part, self._gaze.wanted(part))

    def show(self, shown: Observation) -> None:
        """Moves what looks through the camera."""
        self._camera.show(shown)

    def refresh(self) -> None:
        """Follows frames that come and go."""
        frames = (_NONE, _ALL, *self._buffer.frames())
        follow(self._frames, frames, _NONE)
        if self._frames_scene is not None:
            self._frames_scene.want(_chosen(self._frames.value, frames[2:]))

    def _checkbox(self, part: str, on: bool) -> Any:
        with self._box:
            box = self._gui.add_checkbox(part.capitalize(), on)

        def on_update(_: viser.GuiEvent[Any]) -> None:
            if self._gaze is not None:
                self._gaze.want(part, box.value)

        box.on_update(on_update)
        return box


def _chosen(value: str, frames: tuple[str, ...]) -> tuple[str, ...]:
    if value == _NONE:
        return ()
    return frames if value == _ALL else (value,)
