"""The live data of the page: sampled and encoded once for all browsers."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

from head_tracking.page.calibrating import CameraCalibration
from head_tracking.page.head_modes import FOUND_IN_PICTURES
from head_tracking.page.other_topics import Snapshot
from head_tracking.page.robot import Robot
from head_tracking.page.robot_shapes import RobotForBrowser, number
from head_tracking.page.status import faults
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import Level, Part
from head_tracking.ros.kit.images import frame_pose
from head_tracking.transforms import RobotModel, Vector3
from head_tracking.vision.camera import Camera, camera_with_view
from head_tracking.vision.images import ImageError

_WIDEST = 640  # pixels of a picture
_DISTANCE = 1.5  # m: of a point in an image without a target
_OTHER = "follow"  # what `visual_target` sees and does not follow
_FACE = 0.24  # m: side of the box around a person's face
_SLOW_PERIOD = 0.25  # s between samples of what changes slowly
_MOST_FRAMES = 300  # that are offered
_MOST_LISTED = 200_000  # characters of values in diagnostics
_ORDER = {Level.ERROR: 0, Level.STALE: 1, Level.WARN: 2, Level.OK: 3}


class Live:
    """Samples the robot, one call at a time; `point_at` is for any thread.

    Args:
        robot: is sampled.
        horizontal_view: of a camera without calibration, from side to side [rad].
        report: receives a text when a part begins to fail.

    Attributes:
        texts: JSON objects by their type: `robot` (empty while there is no model), `about` (what
            changes slowly) and `state` (the rest).
        pictures: the latest pictures by topic (empty: the default topic), each with a number that
            differs for each: stamp [ns, 8 bytes, little-endian], then a JPEG.
        meshes: of the robot.
        failing: parts that can't be shown, each with the reason.
        observation: the latest sample.
        calibration: of the camera.
    """

    def __init__(self, robot: Robot, horizontal_view: float, report: Callable[[str], None]) -> None:
        self._robot, self._view, self._report = robot, horizontal_view, report
        self._model: RobotModel | None = None
        self._shown: RobotForBrowser | None = None
        self._slow_due = 0.0
        self._default = ""  # topic of pictures, until it ends or the robot's own exists
        self.texts = {"robot": "", "about": "", "state": ""}
        self.meshes: tuple[bytes, ...] = ()
        self.pictures: Mapping[str, tuple[int, bytes]] = {}
        self.failing: dict[str, str] = {}
        self.observation = Observation(0)
        self.calibration = CameraCalibration(robot, partial(self.latest_picture, exact=True))

    def poll(self) -> None:
        """Receive what has come, while no browser watches."""
        self._attempt("robot", self._robot.poll)

    def sample(self, topics: Collection[str] = ()) -> None:
        """Update the texts, and the pictures of these topics (empty: the default topic)."""
        self._attempt("robot", self._follow_model)
        self.observation = self._attempt("motion", self._robot.observe) or self.observation
        self._set_text("state", joints=self._move, boxes=self._boxes)
        now = time.monotonic()
        if now >= self._slow_due:
            self._slow_due = now + _SLOW_PERIOD
            self._set_text(
                "about",
                stops=lambda: {"stops": self._robot.stop.count},  # whatever fails
                state=self._slow,
                failing=lambda: {"failing": self.failing},
            )
        self._attempt("picture", lambda: self._encode_all(topics))

    def point_at(self, u: float, v: float, stamp: int | None, topic: str = "") -> Vector3:
        """Return the point at a place in the picture, in the model's root [m].

        Args:
            u: fraction of the picture's width, from the left.
            v: fraction of its height, from the top.
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
        distance = _DISTANCE if target is None else math.dist(pose.translation, target)
        camera = self._camera(picture)
        x, y = camera.ray((u * camera.width - 0.5, v * camera.height - 0.5))
        depth = distance / math.hypot(x, y, 1.0)
        return pose @ (x * depth, y * depth, depth)

    def latest_picture(self, topic: str = "", *, exact: bool = False) -> Snapshot | None:
        """Return the latest picture of a topic; empty: of the default topic; see `picture`."""
        topics, own = self._robot.topics.images(), self._robot.topics.own_image
        if own in topics:
            self._default = own
        elif self._default not in topics:
            self._default = min(topics, key=_rank, default="")
        topic = topic or self._default
        return self._robot.topics.picture(topic, exact=exact) if topic in topics else None

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

    def _set_text(self, kind: str, **parts: Callable[[], dict[str, Any]]) -> None:
        """Set the JSON object of a type, with the members of its parts that do not fail."""
        found = [self._attempt(name, partial(_members, part)) for name, part in parts.items()]
        self.texts[kind] = "{" + ", ".join([f'"type": "{kind}"', *filter(None, found)]) + "}"

    def _follow_model(self) -> None:
        """Describe the robot anew when its model has changed."""
        model = self._robot.model()
        if model is None or model is self._model:
            return
        self._model = model  # once: a model that fails is reported and not tried again
        self._shown = None
        self._shown = RobotForBrowser(model, self._robot.head, "/head/mesh/")
        self.meshes = self._shown.meshes
        about = {"type": "robot", **self._shown.about, "view": self._view}
        self.texts["robot"] = json.dumps(about, allow_nan=False)

    def _move(self) -> dict[str, Any]:
        return {} if self._shown is None else self._shown.state(self.observation)

    def _boxes(self) -> dict[str, Any]:
        """Return boxes in the default picture: of what is followed, and of what else is seen."""
        mode, topics = self._robot.mode, self._robot.topics
        picture = self.latest_picture() if mode in FOUND_IN_PICTURES else None
        if picture is None or self._model is None:
            return {"boxes": [], "boxes_of": ""}
        camera, boxes, region = self._camera(picture), [], topics.region()
        if region is not None:
            pose = frame_pose(self._robot.buffer, self._model.root, picture.frame_id, picture.stamp)
            target, distance = self.observation.target, None
            if pose is not None and target is not None:
                distance = math.dist(pose.translation, target)
            boxes.append(_box("", str(mode), region, camera, distance))
        for index, other in enumerate(topics.others(picture.frame_id)):
            face = _face(other.point, camera)
            if face is not None:
                one = _box(f"{_OTHER} {index}", _OTHER, face, camera, math.hypot(*other.point))
                boxes.append({**one, "select": {**asdict(other), "stamp": str(other.stamp)}})
        return {"boxes": boxes, "boxes_of": picture.topic}

    def _slow(self) -> dict[str, Any]:
        robot, live = self._robot, self.observation
        status, outcome, health = robot.status(live), robot.stop.outcome, robot.topics.health()
        servos = robot.joints.servos()
        model = self._model
        links = () if model is None else (model.root, *model.children_of_joints)
        waiting = ["Waiting for robot_description."] if model is None else []
        shapes = [] if self._shown is None else self._shown.about["notices"]
        if model is not None and robot.joints.free:
            movable = list(model.independent_joints)
        else:
            movable = [servo.joint for servo in servos if servo.joint and not servo.refuses]
        return {
            "word": str(status.word),
            "text": status.reason,
            "error": number(live.error),
            "mode": str(robot.mode),
            "modes": [str(mode) for mode in robot.modes.possible()],
            "target_text": live.target_text,
            "can_resume": robot.stop.can_resume,
            "stop": "" if outcome is None else outcome.text,
            "notices": [*waiting, *shapes, *robot.notices()],
            "warnings": list(robot.topics.warnings),
            "servos": [asdict(servo) for servo in servos],
            "movable": movable,
            "free": robot.joints.free,
            "can_recover": robot.joints.can_recover,
            "faults": [
                one._asdict()
                for one in faults(health, robot.modes.missing(), robot.silent_joints())
            ],
            "health": _listed(health),
            "frames": sorted({*robot.buffer.frames()[:_MOST_FRAMES], *links}),
            "has_camera": robot.has_camera,
            "images": sorted(robot.topics.images(), key=_rank),
            "recording": robot.recorder.file is not None,
            "recorder": robot.recorder.status,
            "calibration": self.calibration.progress._asdict(),
        }

    def _encode_all(self, topics: Collection[str]) -> None:
        """Encode a picture of each topic; one that fails costs no other."""
        found, reasons = {}, []
        for topic in topics:
            try:
                picture, before = self.latest_picture(topic), self.pictures.get(topic)
                if picture is not None and before is not None and before[0] == picture.number:
                    found[topic] = before
                elif picture is not None:
                    stamp = picture.stamp.to_bytes(8, "little", signed=True)
                    found[topic] = picture.number, stamp + picture.jpeg(_WIDEST)
            except Exception as error:  # of any kind, as the readers of images raise it
                reasons.append(f"{topic} {error}".strip())
        self.pictures = found
        if reasons:
            raise ImageError("; ".join(reasons))

    def _camera(self, picture: Snapshot) -> Camera:
        camera = self._robot.topics.camera(picture)
        return camera or camera_with_view(picture.width, picture.height, self._view)


def _listed(health: Sequence[Part]) -> list[dict[str, Any]]:
    """Return diagnostics for JSON, worst first. Of too many, the last ones have no values."""
    found, room = [], _MOST_LISTED
    for one in sorted(health, key=lambda one: _ORDER[one.level]):
        room -= sum(len(name) + len(text) for name, text in one.values.items())
        shown = one if room >= 0 else replace(one, values={})
        found.append(asdict(shown) | {"level": one.level.name.lower()})
    return found


def _members(part: Callable[[], dict[str, Any]]) -> str:
    """Return the inside of a JSON object."""
    return json.dumps(part(), allow_nan=False)[1:-1]


def _box(
    frame: str,
    label: str,
    box: tuple[float, float, float, float],
    camera: Camera,
    distance: float | None,
) -> dict[str, Any]:
    """Return a box for JSON, in fractions of the picture's size instead of pixels."""
    sizes = (camera.width, camera.height) * 2
    fractions = [pixels / size for pixels, size in zip(box, sizes, strict=True)]
    return {"frame": frame, "label": label, "box": fractions, "distance": distance}


def _face(point: Vector3, camera: Camera) -> tuple[float, float, float, float] | None:
    """Return left, top, width and height of a person's face [pixels]; None behind the camera."""
    pixel = None if point[2] < 0.1 else camera.pixel(point)
    if pixel is None:
        return None
    side = _FACE / point[2] * camera.focal_length()
    return pixel[0] - side / 2.0, pixel[1] - side / 2.0, side, side


def _rank(topic: str) -> tuple[bool, bool, str]:
    """Order image topics: plain colour images first; the browser draws the boxes."""
    is_plain = topic.endswith(("image", "image_raw"))
    return topic.endswith("visual_target/image"), not is_plain, topic
