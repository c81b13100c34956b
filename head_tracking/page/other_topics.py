"""The latest messages of a robot's topics: controllers, errors, diagnostics, log and images."""

from __future__ import annotations

import contextlib
import io
import math
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray
from PIL import Image
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, RegionOfInterest
from sensor_msgs.msg import Image as ImageMsg
from std_msgs.msg import Bool, Float64

from head_tracking.page.head_modes import CONTROLLERS, NODES
from head_tracking.recording.recording import ERRORS
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Level, Part, health_from_message
from head_tracking.ros.kit.images import camera_of
from head_tracking.ros.kit.others import Graph
from head_tracking.ros.kit.threads import PolledNode
from head_tracking.ros.kit.topics import LATCHED, MEASUREMENT
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import Target
from head_tracking.vision.camera import Camera, CameraError
from head_tracking.vision.images import ImageError, decode_depth, decode_picture, rows_of

_MOST_WARNINGS = 6
_FRESH = 1.0  # s
_SILENT = 3.5  # s: diagnostics come once a second
_UNUSED = 3.0  # s without a request until a subscription ends
_DISCOVERY_PERIOD = 0.25  # s
_MOST_STATUSES = 200  # of a node
_MOST_STRANGERS = 50  # names in diagnostics that are no nodes
_MOST_OTHERS = 20  # marked in the picture
_MOST_VALUES = 200  # of a status
_MOST_TEXT = 1000  # characters
_LOG = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_WARN = 30  # rcl_interfaces/Log.WARN, which some builds give as bytes
_LATEST = QoSProfile(depth=1)
_REGION, _OTHERS = "visual_target/roi", "visual_target/others"
_FORMATS = ("JPEG", "PNG", "TIFF", "WEBP")  # others, such as EPS, would start programs
_MOST_PIXELS = 25e6  # of an image: it takes 0.2 s to decode
_QUALITY, _JPEG = 80, b"\xff\xd8\xff"  # of JPEG; its first bytes
_IMAGE, _COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_CAMERA_KINDS = (_IMAGE, _COMPRESSED_IMAGE, _CAMERA_INFO)
_COMPRESSED = "/compressed"  # below the topic of the raw image, as image_transport publishes it


class Received(NamedTuple):
    """A message and when it was received [s, monotonic]."""

    at: float
    message: Any


class Snapshot(NamedTuple):
    """An image of a camera.

    Attributes:
        topic: of the image; a compressed one is published below it.
        number: differs for each image.
        width: [pixels].
        height: [pixels].
    """

    topic: str
    number: int
    message: ImageMsg | CompressedImage
    width: int
    height: int

    @property
    def stamp(self) -> int:
        """When it was taken [ns]."""
        return stamp_to_ns(self.message.header.stamp)

    @property
    def frame_id(self) -> str:
        """The camera's optical frame."""
        return str(self.message.header.frame_id)

    def jpeg(self, widest: int) -> bytes:
        """Return it as a JPEG of at most this width [pixels]; see `image_of`.

        A JPEG that is not wider stays as the camera has compressed it.
        """
        if isinstance(self.message, CompressedImage) and self.width <= widest:
            data = bytes(self.message.data)
            if data.startswith(_JPEG):
                return data
        image, file = image_of(self.message), io.BytesIO()
        image.reduce(max(1, -(-self.width // widest))).save(file, "JPEG", quality=_QUALITY)
        return file.getvalue()


class OtherTopics:
    """Keeps the latest messages that tell the state of one robot.

    Frequent topics are subscribed to on request, and only as long as they are requested.

    Args:
        node: subscribes to what comes seldom. `end_unused` must be called in its thread; the rest
            may be called from any.
        polled: subscribes to frequent topics.
        graph: tells what belongs to the robot.

    Attributes:
        own_image: topic of the robot's own camera, which `visual_target` uses, too.
        warnings: the last warnings and errors of the log, latest last.
    """

    def __init__(self, node: Node, polled: PolledNode, graph: Graph) -> None:
        self._node, self._polled, self._graph = node, polled, graph
        self._received: dict[str, Received] = {}
        self._requested: dict[str, float] = {}
        self._subscriptions: dict[str, Any] = {}
        self._requesting = threading.Lock()
        self._diagnostics: dict[str, dict[str, Received]] = {}
        self.warnings: tuple[str, ...] = ()
        self._topics: dict[str, set[str]] = {kind: set() for kind in _CAMERA_KINDS}
        self.own_image = node.resolve_topic_name("image")
        self._pictures: dict[str, Snapshot] = {}
        self._discovery_due = 0.0
        for name in NODES:
            self._subscribe(node, Bool, f"{name}/enabled", LATCHED)
        for name in CONTROLLERS:
            self._subscribe(node, DiagnosticStatus, f"{name}/status", LATCHED)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        node.create_subscription(Log, "/rosout", self._on_log, _LOG)

    def end_unused(self) -> None:
        """End the subscriptions that nobody has requested lately."""
        due = time.monotonic() - _UNUSED
        with self._requesting:
            for name in [name for name in self._subscriptions if self._requested[name] < due]:
                self._polled.destroy_subscription(self._subscriptions.pop(name))
                self._received.pop(name, None)

    def _request(self, kind: type, name: str, quality: QoSProfile) -> Received | None:
        """Return the latest message of a topic, and keep the subscription for a while."""
        with self._requesting:
            self._requested[name] = time.monotonic()
            if name not in self._subscriptions:
                self._subscriptions[name] = self._subscribe(self._polled, kind, name, quality)
        return self._received.get(name)

    def _subscribe(self, node: Node, kind: type, name: str, quality: QoSProfile) -> Any:
        def receive(message: Any) -> None:
            self._received[name] = Received(time.monotonic(), message)

        return node.create_subscription(kind, name, receive, quality)

    def enabled(self, name: str) -> bool | None:
        """Return whether a node has published that it is enabled; None if it has not."""
        received = self._received.get(f"{name}/enabled")
        return None if received is None else bool(received.message.data)

    def forget(self, name: str) -> None:
        """Drop whether a node that has gone was enabled."""
        self._received.pop(f"{name}/enabled", None)

    def error(self, name: str) -> float | None:
        """Return by how much a controller misses its target [rad]; None: nothing recent."""
        message = _recent(self._request(Float64, ERRORS[name], _LATEST))
        return None if message is None else float(message.data)

    def status(self, name: str) -> Mapping[str, str]:
        """Return the fields of a controller's `~/status`; empty if it has published none."""
        received = self._received.get(f"{name}/status")
        return {} if received is None else health_from_message(received.message).values

    def health(self) -> tuple[Part, ...]:
        """Return the latest diagnostics by name.

        A status of a running node that publishes no diagnostics any more is stale. Those of nodes
        that have gone, and single ones that a node publishes no more, are left out.
        """
        now, nodes, found = time.monotonic(), set(self._graph.nodes), []
        for node, statuses in sorted(self._diagnostics.items()):
            latest = list(statuses.items())
            is_silent = all(now - at > _SILENT for _, (at, _) in latest)
            if is_silent and node not in nodes:
                self._diagnostics.pop(node, None)
                continue
            for name, (at, status) in sorted(latest):
                if now - at < _SILENT:
                    found.append(status)
                elif is_silent:
                    text = f"nothing heard for {now - at:.0f} s; last: {status.message}"
                    values = {**status.values, FAULT: FaultName.SILENT}
                    found.append(Part(status.name, Level.STALE, text, values))
                else:
                    statuses.pop(name, None)
        return tuple(found)

    def region(self) -> tuple[int, int, int, int] | None:
        """Return the box of what `visual_target` follows: left, top, width, height [pixels].

        None if nothing was found lately.
        """
        box = _recent(self._request(RegionOfInterest, _REGION, MEASUREMENT))
        if box is None:
            return None
        return int(box.x_offset), int(box.y_offset), int(box.width), int(box.height)

    def others(self, frame_id: str) -> tuple[Target, ...]:
        """Return where `visual_target` sees what it does not follow, in a camera's frame."""
        found = _recent(self._request(PoseArray, _OTHERS, MEASUREMENT))
        if found is None or found.header.frame_id != frame_id:
            return ()
        stamp = stamp_to_ns(found.header.stamp)
        places = (pose.position for pose in islice(found.poses, _MOST_OTHERS))
        points = ((place.x, place.y, place.z) for place in places)
        return tuple(Target(stamp, frame_id, p) for p in points if all(map(math.isfinite, p)))

    def images(self) -> tuple[str, ...]:
        """Return the topics of images that exist, raw or compressed."""
        now = time.monotonic()
        if now >= self._discovery_due:
            self._discovery_due = now + _DISCOVERY_PERIOD
            known = self._node.get_topic_names_and_types()
            self._topics = {
                kind: {
                    name for name, types in known if kind in types and self._graph.is_below(name)
                }
                for kind in _CAMERA_KINDS
            }
        compressed = {
            name.removesuffix(_COMPRESSED)
            for name in self._topics[_COMPRESSED_IMAGE]
            if name.endswith(_COMPRESSED)
        }
        return tuple(sorted(self._topics[_IMAGE] | compressed))

    def picture(self, topic: str, *, exact: bool = False) -> Snapshot | None:
        """Return the latest image of a topic; None without one.

        Args:
            topic: one of `images`.
            exact: without the losses of its compression, if the camera offers that.

        Raises:
            ImageError: it can't be decoded.
        """
        name, kind = topic, ImageMsg
        is_compressed = f"{topic}{_COMPRESSED}" in self._topics[_COMPRESSED_IMAGE]
        if is_compressed and not (exact and topic in self._topics[_IMAGE]):
            name, kind = f"{topic}{_COMPRESSED}", CompressedImage
        received = self._request(kind, name, MEASUREMENT)
        if received is None:
            return None
        number, known = round(received.at * 1e9), self._pictures.get(name)
        if known is None or known.number != number:
            known = Snapshot(topic, number, received.message, *size_of(received.message))
            self._pictures[name] = known
        return known

    def camera(self, picture: Snapshot) -> Camera | None:
        """Return the calibration of an image; None: no usable one has been received."""
        folder, infos = picture.topic.rpartition("/")[0], self._topics[_CAMERA_INFO]
        for name in (f"{folder}/camera_info", f"{folder.rpartition('/')[0]}/camera_info"):
            received = self._request(CameraInfo, name, MEASUREMENT) if name in infos else None
            with contextlib.suppress(CameraError):
                camera = None if received is None else camera_of(received.message)
                if camera is not None and (camera.width, camera.height) == picture[-2:]:
                    return camera
        return None

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now, nodes, known = time.monotonic(), set(self._graph.nodes), self._diagnostics
        for status in message.status:
            full_name, colon, part = status.name[:_MOST_TEXT].partition(":")
            node = full_name.rpartition("/")[2] or "unnamed"
            name = node + colon + part
            is_allowed = node in known or node in nodes or len(known) < _MOST_STRANGERS
            if not is_allowed or not self._graph.is_own(full_name):
                continue
            statuses = known.setdefault(node, {})
            if len(statuses) >= _MOST_STATUSES and name not in statuses:
                continue
            health = health_from_message(status)
            values = {
                key[:_MOST_TEXT]: text[:_MOST_TEXT]
                for key, text in islice(health.values.items(), _MOST_VALUES)
            }
            text = health.message[:_MOST_TEXT]
            statuses[name] = Received(now, replace(health, name=name, message=text, values=values))

    def _on_log(self, message: Log) -> None:
        node = message.name.replace(".", "/")
        if message.level >= _WARN and self._graph.is_own(node):
            text = f"{node.rpartition('/')[2]}: {message.msg[:_MOST_TEXT]}"
            self.warnings = (*self.warnings[1 - _MOST_WARNINGS :], text)


def _recent(received: Received | None) -> Any:
    """Return a message; None if it was received long ago."""
    is_recent = received is not None and time.monotonic() - received.at < _FRESH
    return received.message if received is not None and is_recent else None


_MODES = {
    "rgb8": ("RGB", "RGB"), "bgr8": ("RGB", "BGR"),
    "rgba8": ("RGBA", "RGBA"), "bgra8": ("RGBA", "BGRA"), "mono8": ("L", "L"),
}  # fmt: skip
"""The encodings that need no OpenCV: the mode of the image and that of the data, for Pillow."""
_DEPTHS = ("16UC1", "32FC1")


def image_of(message: ImageMsg | CompressedImage) -> Image.Image:
    """Return an image in colour or grey; a depth image is bright where it is near.

    Raises:
        ImageError: it is damaged or too large, or its encoding is not supported.
        OpenCVMissingError: its encoding needs OpenCV.
    """
    if isinstance(message, CompressedImage):
        try:
            opened = Image.open(io.BytesIO(message.data), formats=_FORMATS)
            _check_size(*opened.size)
            return opened if opened.mode in ("L", "RGB") else opened.convert("RGB")
        except ImageError:
            raise
        except Exception as error:  # a damaged file makes its reader raise any error
            raise ImageError(
                f"the compressed image is damaged, too large, or none of {', '.join(_FORMATS)}"
            ) from error
    _check_size(message.width, message.height)
    if message.encoding in _DEPTHS:
        depths = np.nan_to_num(decode_depth(message).metres(), nan=np.inf)
        return Image.fromarray((255.0 / (1.0 + depths)).astype(np.uint8))  # white is near
    if message.encoding not in _MODES:
        return Image.fromarray(np.ascontiguousarray(decode_picture(message).bgr[..., ::-1]))
    mode, order = _MODES[message.encoding]
    rows_of(message, "u1", len(order))  # checks the amount of data
    size = message.width, message.height
    image = Image.frombuffer(mode, size, message.data, "raw", order, message.step, 1)
    return image.convert("RGB") if mode == "RGBA" else image


def _check_size(width: int, height: int) -> None:
    if width * height > _MOST_PIXELS:
        raise ImageError(f"{width}x{height} pixels are too many; allowed are {_MOST_PIXELS:.0f}")


def size_of(message: ImageMsg | CompressedImage) -> tuple[int, int]:
    """Return width and height [pixels]; raise ImageError if a compressed image is damaged."""
    if not isinstance(message, CompressedImage):
        return int(message.width), int(message.height)
    return image_of(message).size  # Pillow decodes one in colour or grey when its pixels are used
