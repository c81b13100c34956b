"""Pictures that nodes publish, in the control panel and in the view cone."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import numpy.typing as npt
import viser

from head_tracking.viewer.gaze_scene import GazeScene
from head_tracking.viewer.head_modes import CAMERA, HeadModes
from head_tracking.viewer.notify import by_person, notify
from head_tracking.viewer.observation import Hold
from head_tracking.viewer.other_topics import OtherTopics

_NONE = "no picture"
_PERIOD = 0.1  # s
_WIDEST = 480  # pixels
_NOTHING = (
    '<div style="padding:0 0.8em;font-size:0.85em">nothing has come yet, or nothing that can be '
    "shown (without OpenCV: rgb8, bgr8, rgba8, bgra8, mono8)</div>"
)


class CameraPicture:
    """A menu of pictures, and a button for the simulated camera.

    A picture is shown as soon as there is one, with what was found in it if a node draws that.
    Whoever publishes them is asked for them only while one is chosen and a browser is there.

    Args:
        gui: viser's control panel, with the container open that gets them.
        topics: have the pictures.
        modes: starts the simulated camera.
        hold: while a recording is shown, what the camera sees now is not.
    """

    def __init__(self, gui: Any, topics: OtherTopics, modes: HeadModes, hold: Hold) -> None:
        self._topics = topics
        self._modes = modes
        self._hold = hold
        self._menu = gui.add_dropdown(
            "Camera picture", [_NONE], hint="Pictures that nodes publish (sensor_msgs/Image)."
        )
        self._start = gui.add_button(
            "Simulate the camera", icon=viser.Icon.CAMERA, visible=False,
            hint="Draws what the head's camera would see: a room, with a ball at the target.",
        )  # fmt: skip
        self._line = gui.add_html("")
        self._image = gui.add_image(np.zeros((3, 4, 3), np.uint8), visible=False)
        self._shown: npt.NDArray[np.uint8] | None = None
        self._next = 0.0
        self._person_chose = False
        self._menu.on_update(self._on_menu)
        self._start.on_click(self._on_start)

    def show(self, gaze: GazeScene | None) -> None:
        """Shows the newest picture, a few times a second; in the view cone, too."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + _PERIOD
        topic = self._menu.value
        picture = None if topic == _NONE or self._hold.reason else self._topics.picture(topic)
        self._image.visible = picture is not None
        missing = topic != _NONE and picture is None and not self._hold.reason
        self._line.content = _NOTHING if missing else ""
        if picture is None:
            if gaze is not None and self._shown is not None:
                gaze.show_picture(None)
                self._shown = None
            return
        every = 1 + picture.shape[1] // _WIDEST
        smaller = picture[::every, ::every]
        if self._shown is None or not np.array_equal(smaller, self._shown):
            self._image.image = self._shown = smaller
            if gaze is not None:
                gaze.show_picture(smaller[::2, ::2])

    def refresh(self) -> None:
        """Follows pictures that come and go."""
        topics = self._topics.images()
        if self._menu.options != (_NONE, *topics):
            chosen = self._menu.value
            self._menu.options = (_NONE, *topics)
            self._menu.value = chosen if chosen in topics else _NONE
        self._start.visible = self._modes.can_start(CAMERA)
        if topics and self._menu.value == _NONE and not self._person_chose:
            self._menu.value = min(topics, key=_rank)

    def _on_menu(self, event: viser.GuiEvent[Any]) -> None:
        self._person_chose = self._person_chose or by_person(event)

    def _on_start(self, event: viser.GuiEvent[Any]) -> None:
        self._person_chose = False
        notify(event, self._modes.start(CAMERA), "Camera")


def _rank(topic: str) -> tuple[bool, bool, str]:
    """What is shown first: with detections in it, then pictures rather than depths."""
    plain = topic.endswith(("image", "image_raw"))
    return not topic.endswith("visual_target/image"), not plain, topic
