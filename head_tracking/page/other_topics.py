"""Topics of other nodes: what is switched on, errors, states, diagnostics, log, pictures."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
from std_msgs.msg import Bool, Float64, String

from head_tracking.recording.recording import ERRORS
from head_tracking.ros.kit.diagnostics import Health, Level, health_from_message
from head_tracking.ros.kit.graph import Graph
from head_tracking.ros.kit.images import camera_of, raw_image
from head_tracking.ros.kit.joint_owners import control_from_message
from head_tracking.ros.kit.qos import LATCHED, MEASUREMENT
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.vision.camera import Camera, CameraError
from head_tracking.vision.images import ImageError, decode_picture
from head_tracking.vision.opencv import OpenCVMissingError

_SWITCHED = (*ERRORS, "fictitious_target", "visual_target", "target_mux", "frame_target")
_COMPLAINT_AGE = 5.0  # s
_FRESH = 1.0  # s
_SILENT = 3.5  # s: diagnostics come once a second
_UNWATCHED = 3.0  # s
_FIND_PERIOD = 0.25  # s between two looks for pictures
_LOG = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_WARN = 30  # rcl_interfaces/Log.WARN, which some builds give as bytes
_NEWEST = QoSProfile(depth=1)
_REGION = "visual_target/roi"


class Heard(NamedTuple):
    """Something heard at a time [s, monotonic]."""

    at: float
    what: Any


class Logged(NamedTuple):
    """What a node has logged at a time [s, monotonic]."""

    at: float
    node: str
    level: int
    text: str


class Picture(NamedTuple):
    """What a camera has seen.

    Attributes:
        number: another one for each picture.
        stamp: when [ns].
        frame_id: the camera's optical frame.
        pixels: shape (height, width, 3), RGB.
        camera: its calibration; None: nobody has told a usable one.
    """

    number: int
    stamp: int
    frame_id: str
    pixels: npt.NDArray[np.uint8]
    camera: Camera | None


class OtherTopics:
    """The newest of everything that tells how a robot does; of one namespace only.

    Latched topics are heard from the start, however late that is.

    Args:
        node: listens. `look` must be called in its thread; the rest may be called from any.
        graph: says what belongs to the robot.
    """

    def __init__(self, node: Node, graph: Graph) -> None:
        self._node = node
        self._graph = graph
        self._heard: dict[str, Heard] = {}
        self._asked: dict[str, Any] = {}
        self._asking = threading.Lock()
        self._diagnostics: dict[str, Heard] = {}
        self._log: deque[Logged] = deque(maxlen=100)
        self._log_lock = threading.Lock()
        self._watched: dict[str, float] = {}
        self._images: tuple[str, ...] = ()
        self._infos: tuple[str, ...] = ()
        self._find_due = 0.0
        for name in _SWITCHED:
            self._listen(Bool, f"{name}/enabled", LATCHED)
        for name in ERRORS:
            self._listen(String, f"{name}/state", LATCHED)
        self._owners: Mapping[str, str] = {}
        node.create_subscription(DiagnosticStatus, "joint_control", self._on_control, LATCHED)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        node.create_subscription(Log, "/rosout", self._on_log, _LOG)

    def look(self) -> None:
        """Listen no more to what nobody has asked for lately."""
        due = time.monotonic() - _UNWATCHED
        with self._asking:
            for name in [name for name in self._asked if self._watched[name] < due]:
                self._node.destroy_subscription(self._asked.pop(name))
                self._heard.pop(name, None)

    def _ask(self, name: str, kind: type, quality: QoSProfile) -> None:
        """Listen to a topic from now on, for as long as it is asked for."""
        with self._asking:
            self._watched[name] = time.monotonic()
            if name not in self._asked:
                self._asked[name] = self._listen(kind, name, quality)

    def enabled(self, name: str) -> bool | None:
        """Whether a node says that it is switched on; None if it has said nothing."""
        said = self._heard.get(f"{name}/enabled")
        return None if said is None else bool(said.what.data)

    def forget(self, name: str) -> None:
        """Drops what a node that has gone said of itself."""
        self._heard.pop(f"{name}/enabled", None)

    def owners(self) -> Mapping[str, str]:
        """The node that each joint obeys, without its namespace; empty for nobody."""
        return {joint: owner.rpartition("/")[2] for joint, owner in self._owners.items()}

    def error(self, name: str) -> float | None:
        """Return by how much the head misses the target of a node that turns it, now [rad].

        None if nothing was heard lately. To ask keeps the subscription.
        """
        self._ask(ERRORS[name], Float64, _NEWEST)
        heard = self._heard.get(ERRORS[name])
        fresh = heard is not None and time.monotonic() - heard.at < _FRESH
        return float(heard.what.data) if heard is not None and fresh else None

    def state(self, name: str) -> str:
        """What a node that turns the head says of itself, or what it logged last."""
        said = self._heard.get(f"{name}/state")
        if said is not None:
            return str(said.what.data)
        lines = [one for one in self._logged() if one.node == name and one.level < _WARN]
        complaint = self.complaint(name)
        return (lines[-1].text if lines else "") + (f" ({complaint})" if complaint else "")

    def complaint(self, name: str, since: float | None = None) -> str:
        """What a node has warned of last, if it has said nothing better since; or nothing.

        Args:
            name: the node.
            since: from this time on [s, monotonic]; None: lately.
        """
        start = time.monotonic() - _COMPLAINT_AGE if since is None else since
        lines = [one for one in self._logged() if one.node == name and one.at >= start]
        return lines[-1].text if lines and lines[-1].level >= _WARN else ""

    def warnings(self) -> tuple[str, ...]:
        """What nodes warned of, newest last."""
        return tuple(f"{one.node}: {one.text}" for one in self._logged() if one.level >= _WARN)

    def health(self) -> tuple[Health, ...]:
        """Return the latest diagnostics by name.

        A node that is there and has said nothing lately is stale. What a node that has gone said,
        and what one says no more beside its other diagnostics, is left out.
        """
        now, latest = time.monotonic(), dict(self._diagnostics)
        speaking = {_source(name) for name, heard in latest.items() if now - heard.at < _SILENT}
        silent = set(self._graph.nodes) - speaking
        return tuple(
            heard.what
            if now - heard.at < _SILENT
            else Health(
                name,
                Level.STALE,
                f"nothing heard for {now - heard.at:.0f} s; last: {heard.what.message}",
                heard.what.values,
            )
            for name, heard in sorted(latest.items())
            if now - heard.at < _SILENT or _source(name) in silent
        )

    def region(self) -> tuple[int, int, int, int] | None:
        """Return the box of what `visual_target` follows: left, top, width, height [pixels].

        None if nothing was found lately. To ask keeps the subscription: finding things costs time.
        """
        self._ask(_REGION, RegionOfInterest, MEASUREMENT)
        heard = self._heard.get(_REGION)
        if heard is None or time.monotonic() - heard.at > _FRESH:
            return None
        box = heard.what
        return int(box.x_offset), int(box.y_offset), int(box.width), int(box.height)

    def images(self) -> tuple[str, ...]:
        """Return the topics with pictures: found while somebody asks, and only then."""
        now = time.monotonic()
        if now >= self._find_due:
            self._find_due = now + _FIND_PERIOD
            known = [
                (name, types)
                for name, types in self._node.get_topic_names_and_types()
                if self._graph.is_below(name)
            ]
            self._images, self._infos = (
                tuple(sorted(name for name, types in known if kind in types))
                for kind in ("sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo")
            )
        return self._images

    def picture(self, topic: str) -> Picture | None:
        """Return the latest picture; to ask keeps the subscription."""
        self._ask(topic, Image, MEASUREMENT)
        heard = self._heard.get(topic)
        pixels = None if heard is None else pixels_of(heard.what)
        if heard is None or pixels is None:
            return None
        header = heard.what.header
        size = (pixels.shape[1], pixels.shape[0])
        return Picture(
            round(heard.at * 1e9),
            stamp_to_ns(header.stamp),
            header.frame_id,
            pixels,
            self._camera(topic, size),
        )

    def _camera(self, topic: str, size: tuple[int, int]) -> Camera | None:
        """What took the pictures of a topic, if it fits their size."""
        for name in _camera_infos(topic):
            if name in self._infos:
                self._ask(name, CameraInfo, MEASUREMENT)
            heard = self._heard.get(name)
            if heard is not None:
                with contextlib.suppress(CameraError):
                    camera = camera_of(heard.what)
                    if (camera.width, camera.height) == size:
                        return camera
        return None

    def _listen(self, kind: type, name: str, quality: QoSProfile) -> Any:
        def keep(message: Any) -> None:
            self._heard[name] = Heard(time.monotonic(), message)

        return self._node.create_subscription(kind, name, keep, quality)

    def _on_control(self, message: DiagnosticStatus) -> None:
        self._owners = control_from_message(message).owners

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in message.status:
            node, colon, part = status.name.partition(":")
            if not self._graph.is_own(node):
                continue
            name = node.rpartition("/")[2] + colon + part
            self._diagnostics[name] = Heard(now, replace(health_from_message(status), name=name))

    def _on_log(self, message: Log) -> None:
        node = message.name.replace(".", "/")
        if self._graph.is_own(node):
            name = node.rpartition("/")[2]
            with self._log_lock:
                self._log.append(Logged(time.monotonic(), name, message.level, message.msg))

    def _logged(self) -> tuple[Logged, ...]:
        with self._log_lock:
            return tuple(self._log)


def _source(name: str) -> str:
    """Return the node that a name in diagnostics begins with."""
    return name.partition(":")[0]


def _camera_infos(topic: str) -> tuple[str, ...]:
    """Where the calibration of a topic's camera may be: beside it, or beside the node above it."""
    folder = topic.rpartition("/")[0]
    return f"{folder}/camera_info", f"{folder.rpartition('/')[0]}/camera_info"


def pixels_of(message: Image) -> npt.NDArray[np.uint8] | None:
    """An image message as RGB; None if it is damaged, or its encoding can't be shown here."""
    image = raw_image(message)
    try:
        match image.encoding:
            case "rgb8" | "rgba8":  # the usual ones do without OpenCV
                return image.rows("u1", len(image.encoding) - 1)[..., :3]
            case "bgr8" | "bgra8":
                return image.rows("u1", len(image.encoding) - 1)[..., 2::-1]
            case "mono8":
                return np.repeat(image.rows("u1", 1), 3, axis=2)
            case _:
                return decode_picture(image).bgr[..., ::-1]
    except (ImageError, OpenCVMissingError):
        return None
