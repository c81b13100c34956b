"""Where the head looks: a mode, a point, a frame; and the gizmo that drags the target."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import viser

from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.transforms import TransformBuffer, TransformException, Vector3
from head_tracking.viewer.head_modes import HeadModes, Mode
from head_tracking.viewer.notify import by_person, follow, notify, refusal
from head_tracking.viewer.path_panel import PathPanel

_NOT_YET = "(no frame yet)"
_DRAG_PERIOD = 0.05  # s
_FARTHEST = 20.0  # m: beyond that the ground is the horizon
_AFTER_DRAG = 1.0
"""So long after a drag the gizmo stays where it was put, before it follows the target."""


class _Inputs(NamedTuple):
    """The frame and the point that one browser has chosen."""

    frame: Any
    point: Any


class SteeringPanel:
    """Mode, "Centre" and gizmo for all browsers; frame menu, x y z and "Point head" for each.

    Args:
        server: gets the inputs, in the container that is open now.
        modes: obeys them.
        buffer: has the frames.

    Attributes:
        path: to look along.
    """

    def __init__(
        self, server: viser.ViserServer, modes: HeadModes, buffer: TransformBuffer
    ) -> None:
        gui = server.gui
        self._server = server
        self._modes = modes
        self._buffer = buffer
        self._root = ""
        self._dragged = 0.0
        self._mode = gui.add_dropdown(
            "Look at", [str(Mode.OFF)],
            hint="nothing: the head is left alone. point: turn to each point once. track: stay on "
            "it. face, ball, marker: what the camera finds. follow a frame: look at the frame "
            "chosen below. path: along a line. fictitious target: the tutorial's moving point. A "
            "click into the camera's picture, or with point and track on the floor, looks there.",
        )  # fmt: skip
        self._box = gui.add_folder(None)
        self._inputs: dict[int | None, _Inputs] = {}
        centre = gui.add_button("Centre", icon=viser.Icon.FOCUS_CENTERED)
        self._gizmo_wanted = gui.add_checkbox(
            "Drag the target", True, hint="Shows the handles that drag the target in the scene."
        )
        self._refusal = gui.add_html("")
        self.path = PathPanel(server, modes, self._point_in_root)
        self._gizmo = server.scene.add_transform_controls(
            "/gizmo", 0.18, disable_rotations=True, disable_sliders=True, depth_test=False,
            position=(1.0, 0.0, 0.5),
        )  # fmt: skip
        centre.on_click(lambda event: self._tell(event, modes.centre(), "Centre"))
        self._mode.on_update(self._on_mode)
        self._gizmo_wanted.on_update(lambda _: self._show_gizmo())
        self._gizmo.on_update(self._on_drag)
        server.scene.on_click()(self._on_scene)

    def set_root(self, root: str) -> None:
        """The frame that the scene is drawn in."""
        self._root = root

    def show(self, shown: Observation) -> None:
        """Lets the gizmo follow the target, unless somebody holds it."""
        if shown.target is not None and time.monotonic() - self._dragged > _AFTER_DRAG:
            self._gizmo.position = shown.target

    def refresh(self) -> None:
        """Brings the menus and switches up to date, those of browsers that have come, too."""
        frames, clients = self._buffer.frames() or (_NOT_YET,), self._server.get_clients()
        self._inputs = {
            number: self._inputs.get(number) or self._add_inputs(client)
            for number, client in clients.items()
        }
        for one in self._inputs.values():
            follow(one.frame, frames, "base_link" if "base_link" in frames else frames[0])
        mode = self._modes.mode()
        options = tuple(map(str, dict.fromkeys((*self._modes.possible(), mode))))
        if self._mode.options != options:
            self._mode.options = options
        self._mode.value = str(mode)
        self.path.refresh()

    def _add_inputs(self, client: viser.ClientHandle) -> _Inputs:
        """Make the inputs of a browser."""
        with self._box:
            gui = client.gui
            frame = gui.add_dropdown("Frame", [_NOT_YET], hint="The frame of x, y and z.")
            point = gui.add_vector3("x y z (m)", (1.0, 0.0, 0.0), step=0.05)
            button = gui.add_button("Point head", icon=viser.Icon.TARGET)

        def on_point(event: viser.GuiEvent[Any]) -> None:
            outcome = self._modes.look_at(frame.value, point.value, wait=True)
            self._tell(event, outcome, "Point head")

        button.on_click(on_point)
        frame.on_update(self._on_frame)
        return _Inputs(frame, point)

    def _frame_of(self, event: viser.GuiEvent[Any]) -> str:
        """Return the frame that the browser of an event has chosen."""
        inputs = self._inputs.get(event.client_id)
        return "" if inputs is None else str(inputs.frame.value)

    def _on_mode(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if by_person(event):
            mode = Mode(self._mode.value)
            self._tell(event, self._modes.set_mode(mode, self._frame_of(event)), "Look at")

    def _on_frame(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if by_person(event) and self._modes.mode() is Mode.FOLLOW:
            outcome = self._modes.set_mode(Mode.FOLLOW, self._frame_of(event))
            self._tell(event, outcome, "Look at")

    def _on_drag(self, event: viser.TransformControlsEvent) -> None:
        now = time.monotonic()
        if self._root and (event.phase == "end" or now - self._dragged >= _DRAG_PERIOD):
            self._dragged = now
            self._send_gizmo()

    def _on_scene(self, event: viser.SceneClickEvent) -> None:
        """Looks at a place on the floor, where a person chooses points anyway."""
        if not self._root or self._modes.mode() not in (Mode.POINT, Mode.TRACK):
            return
        origin, direction = tuple(event.ray_origin), tuple(event.ray_direction)
        point = point_on_ground(origin, direction)
        if point is not None:
            outcome = self._modes.look_at(self._root, point)
            self._refusal.content = "" if outcome.done else refusal(outcome.text)

    def _point_in_root(self, event: viser.GuiEvent[Any]) -> Vector3 | None:
        """Return the point that the browser of an event has chosen, in the robot's root [m]."""
        inputs = self._inputs.get(event.client_id)
        if inputs is None:
            return None
        try:
            return self._buffer.transform_point(inputs.point.value, self._root, inputs.frame.value)
        except TransformException:
            return None

    def _send_gizmo(self) -> None:
        x, y, z = map(float, self._gizmo.position)
        outcome = self._modes.look_at(self._root, (x, y, z))
        if not outcome.done:
            self._refusal.content = refusal(outcome.text)

    def _show_gizmo(self) -> None:
        self._gizmo.visible = self._gizmo_wanted.value

    def _tell(self, event: viser.GuiEvent, outcome: Outcome, title: str) -> None:
        self._refusal.content = "" if outcome.done else refusal(outcome.text)
        notify(event, outcome, title)


def point_on_ground(origin: Vector3, direction: Vector3) -> Vector3 | None:
    """Where a line of sight from an origin [m] meets the floor; None: nowhere, or too far."""
    down = direction[2]
    along = -origin[2] / down if abs(down) > 1e-9 else -1.0
    if along <= 0.0 or along * math.hypot(*direction) > _FARTHEST:
        return None
    x, y, z = (a + along * b for a, b in zip(origin, direction, strict=True))
    return x, y, z
