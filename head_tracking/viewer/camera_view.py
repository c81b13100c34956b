"""The scene as the head's camera sees it, in place of a browser's own view."""

from __future__ import annotations

from typing import Any, NamedTuple

import viser

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation
from head_tracking.ros.other_services import Outcome
from head_tracking.transforms import LookupException, RobotModel, Transform
from head_tracking.viewer.gaze_scene import ViewParameters
from head_tracking.viewer.notify import notify
from head_tracking.viewer.reachable_field import with_axis_forward
from head_tracking.viewer.robot_scene import wxyz

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
