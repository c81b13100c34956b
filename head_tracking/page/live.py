"""What all browsers are shown now: sampled once, encoded once, however many watch."""

from __future__ import annotations

import io
import json
import math
import struct
import time
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from head_tracking.recording.recording import Observation
from head_tracking.ros.images import frame_pose
from head_tracking.transforms import RobotModel, Transform, Vector3
from head_tracking.viewer.head_modes import Mode
from head_tracking.viewer.joint_control import _joint_of
from head_tracking.viewer.other_topics import Picture
from head_tracking.viewer.robot import Robot
from head_tracking.viewer.shapes import FindPackage, robot_look
from head_tracking.vision.camera import Camera, camera_with_view

from .robot_shapes import described

_WIDEST, _QUALITY = 640, 80  # pixels, of JPEG
_AHEAD = 1.5  # m: distance of what a person points at where none is known
_FACE = 0.24  # m: side of the box around a person's face
_SLOW = 0.25  # s between samples of what changes slowly
_HEADER = struct.Struct("<qd")


class Shown(NamedTuple):
    """A picture for browsers.

    Attributes:
        number: another one for each picture.
        data: stamp [ns] and seconds of monotonic time, then a JPEG.
    """

    number: int
    data: bytes


class Live:
    """Samples the robot; for one thread.

    Args:
        robot: sampled.
        find_package: for meshes at package:// addresses.
        horizontal_view: of a camera without calibration, from side to side [rad].

    Attributes:
        robot_text: the robot as JSON; empty while there is no model.
        meshes: of that robot, binary STL.
        failing: parts that can't be shown, each with the reason.
    """

    def __init__(self, robot: Robot, find_package: FindPackage, horizontal_view: float) -> None:
        self._robot = robot
        self._find_package = find_package
        self._horizontal_view = horizontal_view
        self._model: RobotModel | None = None
        self._shown: Shown | None = None
        self._slow: dict[str, Any] = {}
        self._slow_due = 0.0
        self._stopped = 0
        self.robot_text = ""
        self.meshes: tuple[bytes, ...] = ()
        self.failing: dict[str, str] = {}
        self.observation = Observation(0)

    def sample(self) -> str:
        """Return the state of the robot as JSON. A part that fails is named in it."""
        state: dict[str, Any] = {"type": "state"}
        for part, add in (
            ("robot", self._add_robot),
            ("motion", self._add_motion),
            ("faces", self._add_faces),
            ("state", self._add_slow),
        ):
            try:
                state |= add()
                self.failing.pop(part, None)
            except Exception as error:
                # one bad message costs its part of the page, never the page
                self.failing[part] = f"{type(error).__name__}: {error}"
        try:
            return json.dumps(state | {"failing": self.failing}, allow_nan=False)
        except (TypeError, ValueError) as error:
            return json.dumps({"type": "state", "failing": {**self.failing, "page": str(error)}})

    def picture(self) -> Shown | None:
        """Return the latest picture of the camera, encoded once; None if there is none."""
        try:
            shown = self._encoded()
            self.failing.pop("picture", None)
        except Exception as error:
            # drivers and their messages fail in ways that nobody lists
            self.failing["picture"] = f"{type(error).__name__}: {error}"
            return None
        return shown

    def _encoded(self) -> Shown | None:
        picture = self._latest_picture()
        if picture is None:
            return None
        if self._shown is None or self._shown.number != picture.number:
            every = max(1, -(-picture.pixels.shape[1] // _WIDEST))
            data = io.BytesIO()
            image = Image.fromarray(np.ascontiguousarray(picture.pixels)).reduce(every)
            image.save(data, "JPEG", quality=_QUALITY)
            header = _HEADER.pack(picture.stamp, time.monotonic())
            self._shown = Shown(picture.number, header + data.getvalue())
        return self._shown

    def point_at(self, u: float, v: float, stamp: int | None) -> Vector3:
        """Return the point that a place in the picture shows, in the model's root [m].

        Args:
            u: share of the picture's width, from the left.
            v: share of its height, from the top.
            stamp: of the picture that was clicked [ns]; None: the latest.

        Raises:
            ValueError: there is no picture, or its camera's frame is unknown.
        """
        picture, model = self._latest_picture(), self._model
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

    def _latest_picture(self) -> Picture | None:
        topics = self._robot.topics.images()
        return self._robot.topics.picture(min(topics, key=_rank)) if topics else None

    def _camera(self, picture: Picture) -> Camera:
        height, width = picture.pixels.shape[:2]
        return picture.camera or camera_with_view(width, height, self._horizontal_view)

    def _add_robot(self) -> dict[str, Any]:
        model = self._robot.model()
        if model is not None and model is not self._model:
            robot, self.meshes = described(model, robot_look(model.urdf, self._find_package))
            head = self._robot.head()
            if head is not None:
                robot |= {
                    "pan": head.pan_joint,
                    "tilt": head.tilt_joint,
                    "camera": head.pointing_frame,
                    "axis": list(head.pointing_axis),
                    "pan_limits": _finite(head.pan_limits),
                    "tilt_limits": _finite(head.tilt_limits),
                }
            self.robot_text = json.dumps({"type": "robot", **robot})
            self._model = model
        return {}

    def _add_motion(self) -> dict[str, Any]:
        live = self.observation = self._robot.observe()
        names = () if self._model is None else self._model.independent_joints
        return {
            "stamp": live.stamp * 1e-9,
            "joints": [_number(live.joints.get(name)) for name in names],
            "target": None if live.target is None else list(map(_number, live.target)),
            "error": _number(live.error),
        }

    def _add_faces(self) -> dict[str, Any]:
        people = {
            name: place for name, place in self.observation.frames.items() if "person" in name
        }
        picture = self._latest_picture() if people else None
        if picture is None or self._model is None:
            return {"faces": []}
        pose = frame_pose(self._robot.buffer, self._model.root, picture.frame_id, picture.stamp)
        if pose is None:
            return {"faces": []}
        camera, inverse = self._camera(picture), pose.inverse()
        faces = (_face(name, place, inverse, camera) for name, place in sorted(people.items()))
        return {"faces": [face for face in faces if face is not None]}

    def _add_slow(self) -> dict[str, Any]:
        now = time.monotonic()
        if now < self._slow_due:
            return self._slow
        self._slow_due = now + _SLOW
        robot = self._robot
        badge, outcome = robot.badge(self.observation), robot.stop.outcome
        health = robot.health()
        self._slow = {
            "word": str(badge.word),
            "text": badge.text,
            "mode": str(robot.modes.mode()),
            "modes": [str(mode) for mode in robot.modes.possible()],
            "stopped": robot.stop.stopped,
            "can_resume": robot.stop.can_resume,
            "stop": "" if outcome is None else outcome.text,
            "notices": list(robot.notices()),
            "servos": [
                {
                    "controller": servo.controller,
                    "joint": servo.joint,
                    "torque": servo.torque,
                    "values": next(
                        (dict(one.values) for one in health if _joint_of(one) == servo.joint), {}
                    ),
                }
                for servo in robot.joints.servos()
            ],
            "health": [
                {"name": one.name, "level": one.level.name.lower(), "message": one.message}
                for one in health
            ],
            "frames": sorted(self.observation.frames),
        }
        return self._slow


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
        "box": [left / across, top / down, side / across, side / down],
        "distance": math.hypot(*point),
    }


def _number(value: float | None) -> float | None:
    """Return a number for JSON; None for none and for those that are not finite."""
    return None if value is None or not math.isfinite(value) else round(float(value), 6)


def _finite(limits: Any) -> list[float]:
    return [max(limits.lower, -math.pi), min(limits.upper, math.pi)]


def _rank(topic: str) -> tuple[bool, bool, str]:
    """Order image topics: plain colour images first; boxes are drawn by the browser."""
    plain = topic.endswith(("image", "image_raw"))
    return topic.endswith("visual_target/image"), not plain, topic


def mode_named(name: str) -> Mode:
    """Return a mode by its name.

    Raises:
        ValueError: there is none.
    """
    return Mode(name)
