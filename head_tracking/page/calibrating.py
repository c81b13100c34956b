"""Calibrates the camera from the page: the head looks around a marker, in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from head_tracking.exceptions import HeadTrackingError, UnreachableError
from head_tracking.page.head_modes import POINTER, Mode
from head_tracking.page.other_topics import Picture
from head_tracking.page.robot import Robot
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.share import state_folder
from head_tracking.transforms import LATEST, TransformBuffer, Vector3
from head_tracking.vision.camera import Camera
from head_tracking.vision.images import Pixels
from head_tracking.vision.markers import MarkerParameters

_POLL: Final = 0.02  # s
_START: Final = 0.5  # s after which a head that turns has begun
_AT_REST: Final = 0.4  # s without motion
_STILL: Final = 0.004  # rad: less is no motion
_INFO: Final = 2.0  # s for a picture and its camera_info
_PATIENCE: Final = 10.0  # s for an arrival, or a picture


class CalibrationEndedError(HeadTrackingError):
    """The calibration was ended; the message says by what."""


class Progress(NamedTuple):
    """How the calibration goes.

    Attributes:
        runs: whether the head looks around now.
        text: what goes on, or how it has ended.
        rows: what was measured: name, change and deviation, for a person.
    """

    runs: bool = False
    text: str = ""
    rows: tuple[tuple[str, str, str], ...] = ()


class CameraCalibration:
    """Calibrates the camera once it is asked to; a STOP or another mode ends that.

    Args:
        robot: that looks around.
        picture: returns the latest picture of a topic; empty: of the camera.

    Attributes:
        progress: how it goes.
    """

    def __init__(self, robot: Robot, picture: Callable[[str], Picture | None]) -> None:
        self._robot, self._picture = robot, picture
        self._busy = threading.Lock()
        self.progress = Progress()

    def begin(self, marker_size: float, topic: str) -> Outcome:
        """Let the head look around.

        Args:
            marker_size: edge of the marker's black square [m].
            topic: of the pictures; empty: the camera's.
        """
        if not 0.005 <= marker_size <= 2.0:
            raise ValueError(f"The marker's edge is {marker_size} m; allowed are 0.005 to 2 m.")
        if self._robot.stop.refusal:
            return Outcome(False, self._robot.stop.refusal)
        if self._robot.head() is None:
            return Outcome(False, "the model has no head")
        if any(one.name.endswith(": calibration") for one in self._robot.health()):
            text = "this run has a calibration already: start without --calibration to measure anew"
            return Outcome(False, text)
        if not self._busy.acquire(blocking=False):
            return Outcome(False, "the head is looking around already")
        self.progress = Progress(True, "the head begins to look around; STOP ends it")
        marker = MarkerParameters("4X4_50", -1, marker_size)
        threading.Thread(target=self._run, args=(marker, topic), daemon=True).start()
        return Outcome(True, self.progress.text)

    def _run(self, marker: MarkerParameters, topic: str) -> None:
        progress = Progress(text="the calibration has failed")
        head = _PointedHead(self._robot, lambda: self._picture(topic))
        try:
            progress = self._calibrate(head, marker)
        except (HeadTrackingError, OSError, ValueError) as error:
            progress = Progress(text=f"not calibrated: {error}")
        finally:
            head.end()
            self.progress = progress
            self._busy.release()

    def _calibrate(self, head: _PointedHead, marker: MarkerParameters) -> Progress:
        from head_tracking.calibration import summary
        from head_tracking.calibration.gathering import calibrate_camera

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
        file = state_folder("calibration") / f"{calibration.robot}.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        calibration.save(file)
        return Progress(
            text=f"measured, and written to {file}; it counts from the next start with "
            f"--calibration {file}",
            rows=tuple(summary(calibration)),
        )

    def _report(self, text: str) -> None:
        self.progress = Progress(True, text)


class _PointedHead:
    """The head of a robot that is reached by topics; see `TurningHead`.

    Args:
        robot: whose head it is.
        picture: returns the latest picture.
    """

    def __init__(self, robot: Robot, picture: Callable[[], Picture | None]) -> None:
        self._robot, self._picture = robot, picture
        self._stops, self._is_pointed = robot.stop.count, False
        self._usual_speed: Any = None

    @property
    def frames(self) -> TransformBuffer:
        """The robot's frames."""
        return self._robot.buffer

    @property
    def joints(self) -> Mapping[str, float]:
        """The measured positions of pan and tilt [rad]."""
        head = self._robot.head()
        assert head is not None
        found = {
            name: self.frames.latest_joint_position(name)
            for name in (head.pan_joint, head.tilt_joint)
        }
        if None in found.values():
            raise CalibrationEndedError("nobody says where the joints are")
        return {name: each[1] for name, each in found.items() if each is not None}

    def look_at(self, point: Vector3, frame: str, *, max_velocity: float) -> None:
        """Turn to a point [m] and wait until the head is at rest.

        Raises:
            UnreachableError: the head cannot point there; nothing has moved.
            CalibrationEndedError: STOP, another mode, or the head does not come to rest.
        """
        robot = self._robot
        if not self._is_pointed:
            self._begin(max_velocity)
        self._check_mode()
        head = robot.head()
        assert head is not None
        found = self.frames.lookup_transform(head.base_frame, frame, LATEST).transform
        gaze = head.gaze(found @ point, *self.joints.values())
        if not gaze.reached:
            raise UnreachableError(point, frame, np.pi, gaze.reason)
        _check(robot.modes.look_at(frame, point))
        begun = moved = time.monotonic()
        before = self.joints
        while (now := time.monotonic()) < max(begun + _START, moved + _AT_REST):
            if now > begun + _PATIENCE:
                raise CalibrationEndedError("the head does not come to rest")
            time.sleep(_POLL)
            self._check_mode()
            joints = self.joints
            if any(abs(joints[name] - before[name]) > _STILL for name in joints):
                before, moved = joints, now

    def camera(self) -> tuple[str, Camera | None]:
        """Return the frame of the camera, and its lens; None: nobody tells of it.

        Raises:
            CalibrationEndedError: no picture comes.
        """
        begun, picture = time.monotonic(), self._picture()
        while time.monotonic() < begun + _INFO and (picture is None or not picture.camera):
            time.sleep(_POLL)
            self._check_mode()
            picture = self._picture()
        if picture is None:
            raise CalibrationEndedError("there is no picture: choose a camera, or start one")
        return picture.frame_id, picture.camera

    def _begin(self, max_velocity: float) -> None:
        """Let the page alone point the head, at most at a speed [rad/s]."""
        modes, begun = self._robot.modes, time.monotonic()
        _check(modes.set_mode(Mode.POINT))
        self._is_pointed = True
        while (speed := modes.value(POINTER, "max_velocity")) is None:  # it has just been started
            if time.monotonic() > begun + _PATIENCE:
                raise CalibrationEndedError(f"{POINTER} does not say how fast it turns the head")
            time.sleep(_POLL)
            self._check_mode()
        self._usual_speed = speed
        _check(modes.set_value(POINTER, "max_velocity", max_velocity))

    def end(self) -> None:
        """Turn as fast as before."""
        if self._usual_speed is not None:
            self._robot.modes.set_value(POINTER, "max_velocity", self._usual_speed)

    def pictures(self) -> Iterator[tuple[float, Pixels]]:
        """Yield the camera's pictures with their stamps [s], until none comes any more."""
        number, heard = -1, time.monotonic()
        while time.monotonic() < heard + _PATIENCE:
            picture = self._picture()
            if picture is None or picture.number == number:
                time.sleep(_POLL)
                self._check_mode()
                continue
            number, heard = picture.number, time.monotonic()
            yield picture.stamp * 1e-9, np.ascontiguousarray(picture.pixels[:, :, ::-1])

    def _check_mode(self) -> None:
        """Raise CalibrationEndedError if there was a STOP, or somebody has chosen another mode."""
        if self._robot.stop.count != self._stops:
            raise CalibrationEndedError("the head was stopped")
        mode = self._robot.modes.mode()
        if self._is_pointed and mode is not Mode.POINT:
            raise CalibrationEndedError(f"the mode is {mode} now")


def _check(outcome: Outcome) -> None:
    if not outcome.done:
        raise CalibrationEndedError(outcome.text)
