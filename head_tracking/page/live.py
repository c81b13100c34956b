"""What all browsers are shown now: sampled once, encoded once, however many watch."""

from __future__ import annotations

import io
import json
import math
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from head_tracking.gaze import PanTiltHead
from head_tracking.page.advice import troubles
from head_tracking.page.calibrating import CameraCalibration
from head_tracking.page.head_modes import CAMERA, FOUND_IN_PICTURES
from head_tracking.page.joint_control import joint_of
from head_tracking.page.other_topics import Picture
from head_tracking.page.robot import Robot
from head_tracking.page.robot_shapes import RobotForBrowser, described
from head_tracking.page.sample import motion_of
from head_tracking.page.shapes import FindPackage, robot_look
from head_tracking.page.target_path import TargetPath
from head_tracking.parameters import parameter
from head_tracking.recording.recording import LastMinute, Observation
from head_tracking.ros.kit.diagnostics import Level
from head_tracking.ros.kit.images import frame_pose
from head_tracking.transforms import RobotModel, Transform, Vector3
from head_tracking.vision.camera import Camera, camera_with_view

_WIDEST, _QUALITY = 640, 80  # pixels, of JPEG
_AHEAD = 1.5  # m: distance of what a person points at where none is known
_FACE = 0.24  # m: side of the box around a person's face
_HIDDEN = 10**9  # ns: a person of whom nothing has come for so long is not marked
_SLOW = 0.25  # s between samples of what changes slowly
_PREDICTED = 0.1  # s between predictions of the target's path
_RECORDED = 60.0  # s
_HEADER = struct.Struct("<qd")


@dataclass(frozen=True, slots=True)
class ViewParameters:
    """What is drawn around the head."""

    horizontal_view: float = parameter(
        1.0, "Angle of the view cone from side to side.", unit="rad", minimum=0.05, maximum=3.0
    )
    aspect_ratio: float = parameter(
        4 / 3, "Width of the camera's picture over its height.", minimum=0.1, maximum=10.0
    )
    sight_length: float = parameter(
        3.0, "Length of the line of sight.", unit="m", minimum=0.1, maximum=100.0
    )
    field_radius: float = parameter(
        1.0, "Distance at which the reachable field is drawn.", unit="m", minimum=0.1, maximum=50.0
    )
    trail_seconds: float = parameter(
        5.0, "How long the target's trail stays.", unit="s", minimum=0.1, maximum=60.0
    )
    prediction_seconds: float = parameter(
        0.5, "How far ahead the target's path is drawn.", unit="s", minimum=0.05, maximum=5.0
    )


class Shown(NamedTuple):
    """A picture for browsers.

    Attributes:
        number: another one for each picture.
        data: stamp [ns] and seconds of monotonic time, then a JPEG.
    """

    number: int
    data: bytes


class Live:
    """Samples the robot; for one thread, except `point_at`, `describe` and `last_minute`.

    Args:
        robot: sampled.
        find_package: for meshes at package:// addresses.
        view: what is drawn around the head.
        report: receives a sentence when a part begins to fail.

    Attributes:
        robot_text: the robot as JSON; empty while there is no model.
        slow_text: what changes slowly, as JSON.
        meshes: of that robot, binary STL.
        failing: parts that can't be shown, each with the reason.
        last_minute: what has been sampled.
        calibration: of the camera.
    """

    def __init__(
        self,
        robot: Robot,
        find_package: FindPackage,
        view: ViewParameters,
        report: Callable[[str], None],
    ) -> None:
        self._robot = robot
        self._find_package = find_package
        self._view = view
        self._report = report
        self._model: RobotModel | None = None
        self._path: TargetPath | None = None
        self._predicted: list[Any] = []
        self._predict_due = self._slow_due = 0.0
        self._shown: dict[str, Shown] = {}
        self._notices: list[str] = []
        self._camera_asked = False
        self.robot_text = ""
        self.slow_text = ""
        self.meshes: tuple[bytes, ...] = ()
        self.failing: dict[str, str] = {}
        self.last_minute = LastMinute(_RECORDED)
        self.observation = Observation(0)
        self.calibration = CameraCalibration(robot, self.latest_picture)

    def observe(self, *, watched: bool = False) -> None:
        """Add what the robot does now to the last minute."""
        self._attempt("robot", self._follow_model)
        self._attempt("motion", lambda: self._observe(watched=watched))

    def sample(self) -> str:
        """Return the state of the robot as JSON. A part that fails is named in it."""
        self.observe(watched=True)
        state: dict[str, Any] = {"type": "state"}
        for part, add in (
            ("joints", self._motion),
            ("prediction", self._prediction),
            ("boxes", self._boxes),
        ):
            state |= self._attempt(part, add) or {}
        now = time.monotonic()
        if now >= self._slow_due:
            self._slow_due = now + _SLOW
            slow = self._attempt("state", self._slowly) or {}
            self._attempt("page", lambda: self._encode_slow(slow))
        return self._attempt("values", lambda: json.dumps(state, allow_nan=False)) or "{}"

    def picture(self, topic: str = "") -> Shown | None:
        """Return the latest picture of a topic, encoded once; None if there is none.

        Args:
            topic: of the pictures; empty: the first one by `_rank`.
        """
        shown: Shown | None = self._attempt("picture", lambda: self._encoded(topic))
        return shown

    def describe(
        self, model: RobotModel, head: PanTiltHead | None, meshes_at: str
    ) -> RobotForBrowser:
        """Return a robot for the browser; see `described`."""
        look = robot_look(model.urdf, self._find_package)
        return described(model, look, head, self._view.field_radius, meshes_at)

    def point_at(self, u: float, v: float, stamp: int | None, topic: str = "") -> Vector3:
        """Return the point that a place in the picture shows, in the model's root [m].

        Args:
            u: share of the picture's width, from the left.
            v: share of its height, from the top.
            stamp: of the picture that was clicked [ns]; None: the latest.
            topic: of the pictures.

        Raises:
            ValueError: there is no picture, or its camera's frame is unknown.
        """
        picture, model = self.latest_picture(topic), self._model
        if picture is None or model is None:
            raise ValueError("No picture has been received: choose a camera or start one.")
        pose = frame_pose(self._robot.buffer, model.root, picture.frame_id, stamp or picture.stamp)
        if pose is None:
            raise ValueError(f"The transform of the camera frame {picture.frame_id!r} is unknown.")
        target = self.observation.target
        distance = _AHEAD if target is None else math.dist(pose.translation, target)
        camera = self._camera(picture)
        x, y = camera.ray((u * camera.width - 0.5, v * camera.height - 0.5))
        depth = distance / math.hypot(x, y, 1.0)
        return pose @ (x * depth, y * depth, depth)

    def _attempt(self, part: str, add: Callable[[], Any]) -> Any:
        """Return what a function returns; None if it fails, with the reason in `failing`."""
        try:
            found = add()
            self.failing.pop(part, None)
        except Exception as error:
            # one bad message costs its part of the page, never the page
            text = f"{type(error).__name__}: {error}"
            if self.failing.get(part) != text:
                self.failing[part] = text
                self._report(f"{part} can't be shown: {text}")
            return None
        return found

    def _encode_slow(self, slow: dict[str, Any]) -> None:
        text = {"type": "about", **slow, "failing": dict(self.failing)}
        self.slow_text = json.dumps(text, allow_nan=False)

    def _follow_model(self) -> None:
        model = self._robot.model()
        if model is None or model is self._model:
            return
        self._model, head, view = model, self._robot.head(), self._view
        standing = dict.fromkeys(model.independent_joints, 0.0)
        centre: Vector3 = (0.0, 0.0, 0.0)
        if head is not None:
            centre = model.transform(model.root, head.base_frame, standing).translation
        self._path = TargetPath(view.prediction_seconds, centre)
        robot = self.describe(model, head, "/head/mesh/")
        self.meshes, self._notices = robot.meshes, robot.about["notices"]
        self.robot_text = json.dumps(
            {
                "type": "robot",
                **robot.about,
                "view": [view.horizontal_view, view.aspect_ratio, view.sight_length],
                "trail": view.trail_seconds,
            }
        )

    def _observe(self, *, watched: bool) -> None:
        self.observation = self._robot.observe(watched=watched)
        if self._model is not None:
            self.last_minute.add(self.observation)

    def _motion(self) -> dict[str, Any]:
        return motion_of(self.observation, self._model, self._robot.head())

    def _prediction(self) -> dict[str, Any]:
        live, path, now = self.observation, self._path, time.monotonic()
        if path is not None:
            path.add(live.stamp, live.target, live.target_stamp)
            if now >= self._predict_due:
                self._predict_due = now + _PREDICTED
                self._predicted = [[round(x, 4) for x in point] for point in path.predicted()]
        return {"predicted": self._predicted}

    def _boxes(self) -> dict[str, Any]:
        """Return what was found in the picture: what is followed, and the frames of people."""
        latest, oldest = self._robot.buffer.latest_stamps(), self.observation.stamp - _HIDDEN
        people = {
            name: place
            for name, place in self.observation.frames.items()
            if "person" in name and latest.get(name, 0) > oldest
        }
        mode = self._robot.modes.mode()
        region = self._robot.topics.region() if mode in FOUND_IN_PICTURES else None
        picture = self.latest_picture("") if people or region is not None else None
        if picture is None or self._model is None:
            return {"boxes": []}
        camera, boxes = self._camera(picture), []
        pose = frame_pose(self._robot.buffer, self._model.root, picture.frame_id, picture.stamp)
        if region is not None:
            left, top, across, down = region
            width, height = camera.width, camera.height
            target = self.observation.target
            boxes.append(
                {
                    "frame": "",
                    "label": str(mode),
                    "box": [left / width, top / height, across / width, down / height],
                    "distance": None
                    if pose is None or target is None
                    else math.dist(pose.translation, target),
                }
            )
        if pose is not None:
            inverse = pose.inverse()
            faces = (_face(name, place, inverse, camera) for name, place in sorted(people.items()))
            boxes += [face for face in faces if face is not None]
        return {"boxes": boxes}

    def _slowly(self) -> dict[str, Any]:
        robot, live = self._robot, self.observation
        self._start_camera()
        badge, outcome, health = robot.badge(live), robot.stop.outcome, robot.health()
        values = {joint_of(one): dict(one.values) for one in health}
        servos = robot.joints.servos()
        waiting = [] if self._model is not None else ["Waiting for robot_description."]
        return {
            "word": str(badge.word),
            "text": badge.text,
            "mode": str(robot.modes.mode()),
            "modes": [str(mode) for mode in robot.modes.possible()],
            "target_text": live.target_text,
            "state": live.state,
            "stopped": robot.stop.stopped,
            "can_resume": robot.stop.can_resume,
            "stop": "" if outcome is None else outcome.text,
            "notices": [*waiting, *self._notices, *robot.notices()],
            "warnings": list(robot.topics.warnings()[-6:]),
            "servos": [
                {
                    "controller": servo.controller,
                    "joint": servo.joint,
                    "torque": servo.torque,
                    "refuses": servo.refuses,
                    "values": values.get(servo.joint, {}),
                }
                for servo in servos
            ],
            "movable": (
                list(self._model.independent_joints)
                if robot.joints.free and self._model is not None
                else [servo.joint for servo in servos if servo.joint and not servo.refuses]
            ),
            "free": robot.joints.free,
            "can_recover": robot.joints.can_recover,
            "troubles": [one._asdict() for one in troubles(health, live)],
            "health": [
                {
                    "name": one.name,
                    "level": one.level.name.lower(),
                    "message": one.message,
                    "values": dict(one.values),
                }
                for one in sorted(health, key=lambda one: -_GRAVITY[one.level])
            ],
            "frames": list(robot.buffer.frames()),
            "images": sorted(robot.topics.images(), key=_rank),
            "can_start_camera": robot.modes.can_start(CAMERA),
            "recording": robot.recorder.file is not None,
            "recorder": robot.recorder.status,
            "calibration": self.calibration.progress._asdict(),
        }

    def _start_camera(self) -> None:
        """Start the simulated camera once, where there are no pictures."""
        robot = self._robot
        if self._camera_asked or robot.topics.images() or not robot.modes.can_start(CAMERA):
            return
        self._camera_asked = True
        threading.Thread(target=lambda: robot.modes.start(CAMERA), daemon=True).start()

    def _encoded(self, topic: str) -> Shown | None:
        picture = self.latest_picture(topic)
        if picture is None:
            return None
        shown = self._shown.get(topic)
        if shown is None or shown.number != picture.number:
            every = max(1, -(-picture.pixels.shape[1] // _WIDEST))
            data = io.BytesIO()
            image = Image.fromarray(np.ascontiguousarray(picture.pixels)).reduce(every)
            image.save(data, "JPEG", quality=_QUALITY)
            header = _HEADER.pack(picture.stamp, time.monotonic())
            shown = self._shown[topic] = Shown(picture.number, header + data.getvalue())
        return shown

    def latest_picture(self, topic: str) -> Picture | None:
        """Return the latest picture of a topic; empty: of the first one by `_rank`."""
        topics = self._robot.topics.images()
        if topic:
            return self._robot.topics.picture(topic) if topic in topics else None
        return self._robot.topics.picture(min(topics, key=_rank)) if topics else None

    def _camera(self, picture: Picture) -> Camera:
        height, width = picture.pixels.shape[:2]
        return picture.camera or camera_with_view(width, height, self._view.horizontal_view)


_GRAVITY = {Level.ERROR: 3, Level.STALE: 2, Level.WARN: 1, Level.OK: 0}


def _face(name: str, place: Transform, T_camera_root: Transform, camera: Camera) -> Any:
    """Return where a person's face is in the picture, in shares of its size; None: behind it."""
    point = T_camera_root @ place.translation
    pixel = None if point[2] < 0.1 else camera.pixel(point)
    if pixel is None:
        return None
    side = _FACE / point[2] * camera.focal_length()
    left, top = pixel[0] - side / 2.0, pixel[1] - side / 2.0
    across, down = camera.width, camera.height
    return {
        "frame": name,
        "label": name.replace("_", " "),
        "box": [left / across, top / down, side / across, side / down],
        "distance": math.hypot(*point),
    }


def _rank(topic: str) -> tuple[bool, bool, str]:
    """Order image topics: plain colour images first; boxes are drawn by the browser."""
    plain = topic.endswith(("image", "image_raw"))
    return topic.endswith("visual_target/image"), not plain, topic
