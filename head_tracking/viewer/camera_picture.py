"""What the camera sees: in a corner of the view, in the view cone, and as a way to steer."""

from __future__ import annotations

import io
import math
import threading
import time
from typing import Any, NamedTuple

import numpy as np
import viser
from PIL import Image

from head_tracking.ros.kit.other_services import Hold, Outcome
from head_tracking.transforms import Transform, Vector3
from head_tracking.viewer.gaze_scene import GazeScene
from head_tracking.viewer.head_modes import CAMERA, HeadModes
from head_tracking.viewer.notify import by_person, follow, notify, small
from head_tracking.viewer.other_topics import OtherTopics, Picture
from head_tracking.viewer.recording_panel import RecordingPanel
from head_tracking.vision.camera import camera_with_view

_NONE = "no picture"
_CONE_PERIODS = 0.2, 2.0  # s
_PERIODS_OF_BROWSER = 2.5
"""A browser drops a picture of the scene that is not drawn before the next one comes: it gets them
so many times slower than it asks for those in the corner."""

_CONE_WIDEST, _WIDEST = 160, 480  # pixels
_LOOKED_AT = 3.0  # s
_QUALITY = 80  # of JPEG
_NOTHING = (
    "nothing has come yet, or nothing that can be shown (without OpenCV: rgb8, bgr8, rgba8, bgra8, "
    "mono8)"
)


class Jpeg(NamedTuple):
    """A picture for a browser, with its number and stamp [ns]."""

    number: int
    stamp: int
    data: bytes


class CameraPicture:
    """A menu of pictures, and a button for the simulated camera.

    A picture is shown as soon as there is one, with what was found in it if a node draws that;
    where the head is simulated, its camera is started for that. Whoever publishes them is asked
    for them only while one is chosen and somebody looks.

    Args:
        gui: viser's control panel, with the container open that gets them.
        topics: have the pictures.
        modes: starts the simulated camera.
        hold: while a recording is shown, what the camera sees now is not.

    Attributes:
        replay: what is shown in place of the robot, if anything is.
    """

    replay: RecordingPanel | None = None

    def __init__(self, gui: Any, topics: OtherTopics, modes: HeadModes, hold: Hold) -> None:
        self._topics = topics
        self._modes = modes
        self._hold = hold
        self._menu = gui.add_dropdown(
            "Camera picture", [_NONE],
            hint="Pictures that nodes publish (sensor_msgs/Image), shown in the corner and in the "
            "view cone.",
        )  # fmt: skip
        self._start = gui.add_button(
            "Simulate the camera", icon=viser.Icon.CAMERA, visible=False,
            hint="Draws what the head's camera would see: a room, with a ball at the target.",
        )  # fmt: skip
        self._line = gui.add_html("")
        self._in_cone: int | None = None
        self._next = 0.0
        self._browser_takes = 0.0
        self._looked_at = -_LOOKED_AT
        self._person_chose = False
        self._started: threading.Thread | None = None
        self._start_failed = ""
        self._encoding = threading.Lock()
        self._encoded: Jpeg | None = None
        self._menu.on_update(self._on_menu)
        self._start.on_click(self._on_start)

    @property
    def chosen(self) -> str:
        """The topic that is shown; empty: none."""
        if self._hold.reason:
            return self.replay.camera() if self.replay is not None else ""
        return "" if self._menu.value == _NONE else str(self._menu.value)

    def look(self) -> None:
        """Somebody looks at the page now."""
        self._looked_at = time.monotonic()

    def newest(self) -> Picture | None:
        """The newest picture of the topic that is shown; for any thread."""
        if self._hold.reason:
            return self.replay.picture() if self.replay is not None else None
        return self._topics.picture(self.chosen) if self.chosen else None

    def jpeg(self, after: int, took: float) -> Jpeg | None:
        """The newest picture, if there is another one; for any thread.

        Args:
            after: the number of the one that a browser has.
            took: so long ago [s] it asked for that.
        """
        self._browser_takes = max(took, 0.9 * self._browser_takes)
        picture = self.newest()
        if picture is None or picture.number == after:
            return None
        with self._encoding:
            if self._encoded is None or self._encoded.number != picture.number:
                data = io.BytesIO()
                _fitting(picture, _WIDEST).save(data, "JPEG", quality=_QUALITY)
                self._encoded = Jpeg(picture.number, picture.stamp, data.getvalue())
            return self._encoded

    def show(self, gaze: GazeScene | None) -> None:
        """Shows the newest picture in the view cone, a few times a second."""
        now = time.monotonic()
        shown = self._in_cone is not None
        if gaze is None or (now < self._next and not (shown and not self.chosen)):
            return
        least, most = _CONE_PERIODS
        self._next = now + min(max(least, _PERIODS_OF_BROWSER * self._browser_takes), most)
        picture = self.newest() if self._is_looked_at else None
        if picture is None:
            if shown:
                gaze.show_picture(None)
                self._in_cone = None
        elif picture.number != self._in_cone:
            gaze.show_picture(np.asarray(_fitting(picture, _CONE_WIDEST)))
            self._in_cone = picture.number

    def refresh(self) -> None:
        """Follows pictures that come and go."""
        topics = self._topics.images()
        follow(self._menu, (_NONE, *topics), _NONE)
        can_start = self._modes.can_start(CAMERA)
        self._start.visible = can_start
        if topics and not self._person_chose:
            self._menu.value = min(topics, key=_rank)
        if can_start and not topics and self._is_looked_at and self._started is None:
            self._started = threading.Thread(target=self._start_camera, daemon=True)
            self._started.start()
        nothing = self.chosen and self._is_looked_at and self.newest() is None
        self._line.content = small(_NOTHING if nothing else self._start_failed)

    @property
    def _is_looked_at(self) -> bool:
        return time.monotonic() - self._looked_at < _LOOKED_AT

    def _on_menu(self, event: viser.GuiEvent[Any]) -> None:
        self._person_chose = self._person_chose or by_person(event)

    def _on_start(self, event: viser.GuiEvent[Any]) -> None:
        self._person_chose = False
        notify(event, self._start_camera(), "Camera")

    def _start_camera(self) -> Outcome:
        outcome = self._modes.start(CAMERA)
        self._start_failed = "" if outcome.done else outcome.text
        return outcome


def point_in_picture(
    picture: Picture,
    share: tuple[float, float],
    T_root_camera: Transform,
    distance: float,
    horizontal_view: float,
) -> Vector3:
    """The point that a place in a picture shows, in the robot's root [m].

    Args:
        picture: with the calibration of its camera, if there is one.
        share: of its width and of its height, from the upper left corner.
        T_root_camera: where the camera's optical frame was when it took the picture.
        distance: of the point from the camera [m], which a picture does not tell.
        horizontal_view: of a camera without calibration, from side to side [rad].
    """
    height, width = picture.pixels.shape[:2]
    camera = picture.camera or camera_with_view(width, height, horizontal_view)
    x, y = camera.ray((share[0] * width - 0.5, share[1] * height - 0.5))
    depth = distance / math.hypot(x, y, 1.0)
    return T_root_camera @ (x * depth, y * depth, depth)


def _fitting(picture: Picture, widest: int) -> Image.Image:
    """A picture that is no wider than so many pixels."""
    every = -(-picture.pixels.shape[1] // widest)
    return Image.fromarray(np.ascontiguousarray(picture.pixels)).reduce(max(1, every))


def _rank(topic: str) -> tuple[bool, bool, str]:
    """What is shown first: with detections in it, then pictures rather than depths."""
    plain = topic.endswith(("image", "image_raw"))
    return not topic.endswith("visual_target/image"), not plain, topic
