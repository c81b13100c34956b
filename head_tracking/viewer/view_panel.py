"""What is drawn: parts of the scene, frames; and the camera's eye."""

from __future__ import annotations

from typing import Any, NamedTuple

import viser

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.transforms import LookupException, RobotModel, Transform
from head_tracking.viewer.gaze_scene import GazeScene, ViewParameters, with_axis_forward
from head_tracking.viewer.notify import follow, notify
from head_tracking.viewer.robot import Robot
from head_tracking.viewer.robot_scene import FramesScene, wxyz

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


_AHEAD = 0.06  # m: before the camera's own body


class OwnView(NamedTuple):
    """Where a browser looked from before."""

    wxyz: Any
    position: Any
    fov: float


class CameraView:
    """A button that puts a browser's eye where the camera is, and back. Other browsers stay.

    Args:
        server: gets the button, in the container that is open now.
        view: the camera's field of view.
    """

    def __init__(self, server: viser.ViserServer, view: ViewParameters) -> None:
        self._server = server
        self._view = view
        self._before: dict[int, OwnView] = {}
        self._camera: tuple[RobotModel, str, Transform] | None = None
        button = server.gui.add_button(
            "Look through the camera / back", icon=viser.Icon.EYE,
            hint="Shows in this browser what the head's camera sees of the scene.",
        )  # fmt: skip
        button.on_click(self._on_click)
        server.on_client_disconnect(lambda client: self._before.pop(client.client_id, None))

    def set_head(self, model: RobotModel, head: PanTiltHead) -> None:
        """Whose camera it is."""
        x, y, z = axis = head.pointing_axis
        place = Transform((_AHEAD * x, _AHEAD * y, _AHEAD * z), with_axis_forward(axis))
        self._camera = (model, head.pointing_frame, place)

    def show(self, shown: Observation) -> None:
        """Moves the eyes of the browsers that want it."""
        if not self._before or self._camera is None:
            return
        model, frame, place = self._camera
        try:
            eye = model.transform(model.root, frame, shown.joints) @ place
        except LookupException:
            return  # a joint on the way is not known
        for number, client in self._server.get_clients().items():
            if number in self._before:
                with client.atomic():
                    client.camera.wxyz = wxyz(eye.rotation)
                    client.camera.position = eye.translation

    def _on_click(self, event: viser.GuiEvent[Any]) -> None:
        client = event.client
        if client is None:
            return
        before = self._before.pop(client.client_id, None)
        if before is not None:
            client.camera.wxyz, client.camera.position = before.wxyz, before.position
            client.camera.fov = before.fov
        elif self._camera is None:
            notify(event, Outcome(False, "no head is known, so there is no camera"), "Camera")
        else:
            camera = client.camera
            self._before[client.client_id] = OwnView(camera.wxyz, camera.position, camera.fov)
            camera.fov = self._view.vertical_view
