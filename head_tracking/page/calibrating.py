"""Calibration of the camera from the page: the head looks around a marker."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple

from head_tracking.exceptions import HeadTrackingError, UnreachableError
from head_tracking.page.head_modes import POINTER, Mode
from head_tracking.page.other_topics import Snapshot
from head_tracking.page.robot import Robot
from head_tracking.ros.kit.images import picture_of
from head_tracking.share import check_writable, state_folder
from head_tracking.transforms import Vector3
from head_tracking.vision.camera import Camera
from head_tracking.vision.images import ImageError, Pixels
from head_tracking.vision.markers import MarkerParameters

_POLL: Final = 0.02  # s
_START: Final = 0.5  # s within which the head begins to turn
_INFO: Final = 2.0  # s for a picture and its camera_info
_PATIENCE: Final = 10.0  # s until the head rests, or until a picture


class Progress(NamedTuple):
    """The progress of a calibration.

    Attributes:
        runs: whether it is in progress.
        text: the present step, or the result.
        rows: what was measured: name, change and deviation as texts.
    """

    runs: bool = False
    text: str = ""
    rows: tuple[tuple[str, str, str], ...] = ()


class CameraCalibration:
    """Calibrates the camera on request; a STOP, another mode or a relaxed servo ends that.

    Args:
        robot: has the camera.
        picture: returns the latest picture of a topic; empty: of the default topic.
    """

    def __init__(self, robot: Robot, picture: Callable[[str], Snapshot | None]) -> None:
        self._robot, self._picture = robot, picture
        self._busy = threading.Lock()
        self.progress = Progress()

    def begin(self, marker_size: float, topic: str) -> str:
        """Start a calibration; return what happens now.

        Args:
            marker_size: edge of the marker's black square [m].
            topic: of the pictures; empty: the default topic.

        Raises:
            HeadTrackingError: the head is stopped, or cannot be calibrated now.
        """
        self._robot.stop.permit()
        if self._robot.head is None:
            raise HeadTrackingError("The model has no head.")
        if any(one.name.endswith(": calibration") for one in self._robot.topics.health()):
            raise HeadTrackingError(
                "This run uses a calibration: start it without --calibration to calibrate anew."
            )
        if not self._busy.acquire(blocking=False):
            raise HeadTrackingError(
                "A calibration is in progress already: wait for its end, or press STOP."
            )
        self.progress = Progress(True, "The head begins to look around. STOP ends it.")
        marker = MarkerParameters("4X4_50", -1, marker_size)
        head = _PointedHead(self._robot, lambda: self._picture(topic))
        threading.Thread(target=self._run, args=(head, marker), daemon=True).start()
        return self.progress.text

    def _run(self, head: _PointedHead, marker: MarkerParameters) -> None:
        progress = Progress(text="The calibration has failed.")
        try:
            progress = self._calibrate(head, marker)
        except (HeadTrackingError, OSError, ValueError) as error:
            progress = Progress(text=f"Not calibrated: {error}")
        finally:
            head.end()
            self.progress = progress
            self._busy.release()

    def _calibrate(self, head: _PointedHead, marker: MarkerParameters) -> Progress:
        from head_tracking.calibration import summary
        from head_tracking.calibration.gathering import calibrate_camera

        folder = state_folder("calibration")
        folder.mkdir(parents=True, exist_ok=True)
        model = self._robot.buffer.model
        assert model is not None  # `begin` has checked its head
        file = folder / f"{model.name}.yaml"
        check_writable(file)  # else the motion was in vain
        frame, lens = head.camera()
        calibration = calibrate_camera(
            head,
            head.pictures(),
            marker=marker,
            frame=frame,
            model=lens,
            focal_length=lens is None,
            report=self._report,
        )
        head.check()
        calibration.save(file)
        return Progress(
            text=f"Calibrated: {calibration.errors_text}. The result is in {file}. To use it, "
            f"start with --calibration {file}",
            rows=tuple(summary(calibration)),
        )

    def _report(self, text: str) -> None:
        self.progress = Progress(True, text)


class _PointedHead:
    """A `TurningHead` that is commanded by topics."""

    def __init__(self, robot: Robot, picture: Callable[[], Snapshot | None]) -> None:
        self._robot, self._picture, self.frames = robot, picture, robot.buffer
        self._stops = robot.stop.count
        self._normal_speed: Any = None  # until `hold`
        assert robot.head is not None  # `begin` has checked it
        self._joint_names = robot.head.pan_joint, robot.head.tilt_joint

    @property
    def joints(self) -> Mapping[str, float]:
        """The measured positions of pan and tilt [rad]."""
        self._robot.poll()
        found = {}
        for name in self._joint_names:
            measured = self.frames.latest_joint_position(name)
            if measured is None:
                raise HeadTrackingError("no measurements of the joints are received")
            found[name] = measured[1]
        return found

    def look_at(self, point: Vector3, frame: str, *, max_velocity: float) -> None:
        """Turn to a point [m] and wait until the head is at rest.

        Raises:
            UnreachableError: the head cannot point there, or not now; nothing has moved.
            HeadTrackingError: as `check`, or because the head does not come to rest.
        """
        self.check()
        self._robot.modes.set_value(POINTER, "max_velocity", max_velocity)
        self._robot.modes.look_at(frame, point)
        begun, status = time.monotonic(), self._robot.topics.status
        while time.monotonic() < begun + _START or status(POINTER).get("state") == "turning":
            self._wait(begun + _PATIENCE, "the head does not come to rest")
        if refusal := status(POINTER).get("refusal"):
            raise UnreachableError(point, frame, math.pi, refusal)

    def camera(self) -> tuple[str, Camera | None]:
        """Return the frame of the camera, and its lens; None: it is not published.

        Raises:
            HeadTrackingError: no picture is received.
        """
        begun, picture, lens = time.monotonic(), None, None
        while lens is None and time.monotonic() < begun + _INFO:
            self._wait()
            self._robot.poll()
            picture = self._picture()
            lens = None if picture is None else self._robot.topics.camera(picture)
        if picture is None:
            raise HeadTrackingError("no picture is received: choose a camera or start one")
        return picture.frame_id, lens

    def hold(self) -> None:
        """Let only the page point the head, and note its usual speed."""
        modes, begun = self._robot.modes, time.monotonic()
        modes.set_mode(Mode.POINT)
        while (speed := modes.value(POINTER, "max_velocity")) is None:  # it has just been started
            self._wait(begun + _PATIENCE, f"{POINTER} has no parameter max_velocity")
        self._normal_speed = speed

    def end(self) -> None:
        """Restore the speed."""
        if self._normal_speed is not None:
            with suppress(HeadTrackingError):  # the node has ended
                self._robot.modes.set_value(POINTER, "max_velocity", self._normal_speed)

    def pictures(self) -> Iterator[tuple[float, Pixels]]:
        """Yield the camera's pictures with their stamps [s], until no more are received."""
        number, heard = -1, time.monotonic()
        while time.monotonic() < heard + _PATIENCE:
            self._robot.poll()
            with suppress(ImageError):  # a damaged one
                picture = self._picture()
                if picture is not None and picture.number != number:
                    number, pixels = picture.number, picture_of(picture.message).bgr
                    heard = time.monotonic()
                    yield picture.stamp * 1e-9, pixels
            self._wait()

    def _wait(self, deadline: float = math.inf, late: str = "") -> None:
        """Wait a moment; raise HeadTrackingError as `check`, or after the deadline."""
        if time.monotonic() > deadline:
            raise HeadTrackingError(late)
        time.sleep(_POLL)
        self.check()

    def check(self) -> None:
        """Raise HeadTrackingError after a STOP, in another mode, or with a relaxed servo."""
        self._robot.stop.permit(self._stops)
        mode = self._robot.modes.mode()
        if self._normal_speed is not None and mode is not Mode.POINT:
            raise HeadTrackingError(f"the mode is {mode} now")
        for servo in self._robot.joints.servos():
            if servo.refuses and servo.joint in self._joint_names:
                raise HeadTrackingError(f"{servo.joint} is {servo.values['torque']}")
