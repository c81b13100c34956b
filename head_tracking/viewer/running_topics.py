"""Topics of other nodes that may or may not be there: errors, states, diagnostics, pictures."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import Float64, String

from head_tracking.ros.images import raw_image
from head_tracking.tf.qos import MEASUREMENT
from head_tracking.viewer.robot import Health, Level
from head_tracking.vision.images import ImageError, decode_picture
from head_tracking.vision.opencv import OpenCVMissingError

_ERRORS = ("/tracking_error", "/pointing_error")
_TURNS_THE_HEAD = ("head_tracker", "point_head")
_COMPLAINT_AGE = 5.0  # s
_FRESH = 1.0  # s
_SILENT = 3.5  # s: diagnostics come once a second
_UNWATCHED = 3.0  # s
_LOG = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_WARN = 30  # rcl_interfaces/Log.WARN, which some builds give as bytes
_NEWEST = QoSProfile(depth=1)


class Heard(NamedTuple):
    """Something heard at a time [s, monotonic]."""

    at: float
    what: Any


class RunningTopics:
    """The newest of everything that tells how the robot does.

    Args:
        node: listens. `look` must be called in its thread; the rest may be called from any.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._heard: dict[str, Heard] = {}
        self._subscriptions: dict[str, Any] = {}
        self._diagnostics: dict[str, Heard] = {}
        self._log: deque[tuple[float, str, int, str]] = deque(maxlen=100)
        self._watched: dict[str, float] = {}
        self._images: tuple[str, ...] = ()
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        node.create_subscription(Log, "/rosout", self._on_log, _LOG)

    def look(self) -> None:
        """Listens to topics that came."""
        topics = dict(self._node.get_topic_names_and_types())
        wanted: dict[str, tuple[type, QoSProfile]] = {}
        images = []
        for name, types in topics.items():
            if "std_msgs/msg/Float64" in types and name.endswith(_ERRORS):
                wanted[name] = (Float64, _NEWEST)
            elif "std_msgs/msg/String" in types and name.endswith("/state"):
                wanted[name] = (String, _NEWEST)
            elif "sensor_msgs/msg/Image" in types:
                images.append(name)
        now = time.monotonic()
        for name in images:
            if now - self._watched.get(name, -math.inf) < _UNWATCHED:
                wanted[name] = (Image, MEASUREMENT)
        self._images = tuple(sorted(images))
        for name in self._subscriptions.keys() - wanted.keys():
            self._node.destroy_subscription(self._subscriptions.pop(name))
            self._heard.pop(name, None)
        for name in wanted.keys() - self._subscriptions.keys():
            kind, quality = wanted[name]
            self._subscriptions[name] = self._node.create_subscription(
                kind, name, self._keeper(name), quality
            )

    def error(self) -> float | None:
        """By how much the head misses its target now [rad], by who said so last."""
        now = time.monotonic()
        heard = [
            heard
            for name, heard in list(self._heard.items())
            if name.endswith(_ERRORS) and now - heard.at < _FRESH
        ]
        return float(max(heard, key=lambda one: one.at).what.data) if heard else None

    def state(self) -> str:
        """What the node that turns the head says of itself, or what it logged last."""
        states = [
            f"{name.split('/')[-2]}: {heard.what.data}"
            for name, heard in sorted(self._heard.items())
            if name.endswith("/state")
        ]
        if states:
            return "; ".join(states)
        return self._logged_state()

    def _logged_state(self) -> str:
        """What a node that publishes no state said last, and what it complained of lately."""
        now = time.monotonic()
        said = complaint = ""
        for at, logger, level, text in tuple(self._log):
            if logger in _TURNS_THE_HEAD:
                if level < _WARN:
                    said, complaint = f"{logger}: {text}", ""
                elif now - at < _COMPLAINT_AGE:
                    complaint = f" ({text})"
        return said + complaint

    def warnings(self) -> tuple[str, ...]:
        """What nodes warned of, newest last."""
        return tuple(
            f"{logger}: {text}" for _, logger, level, text in tuple(self._log) if level >= _WARN
        )

    def health(self) -> tuple[Health, ...]:
        """The newest diagnostics by name; what is not said any more is stale."""
        now = time.monotonic()
        return tuple(
            heard.what
            if now - heard.at < _SILENT
            else Health(
                name,
                Level.STALE,
                f"nothing heard for {now - heard.at:.0f} s; last: {heard.what.message}",
                heard.what.values,
            )
            for name, heard in sorted(self._diagnostics.items())
        )

    def images(self) -> tuple[str, ...]:
        """Topics with pictures."""
        return self._images

    def picture(self, topic: str) -> npt.NDArray[np.uint8] | None:
        """The newest picture, shape (height, width, 3), RGB; asking keeps its topic listened to."""
        self._watched[topic] = time.monotonic()
        heard = self._heard.get(topic)
        return None if heard is None else picture(heard.what)

    def _keeper(self, name: str) -> Any:
        def keep(message: Any) -> None:
            self._heard[name] = Heard(time.monotonic(), message)

        return keep

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in message.status:
            level = Level(int.from_bytes(status.level, "little"))
            values = {pair.key: pair.value for pair in status.values}
            self._diagnostics[status.name] = Heard(
                now, Health(status.name, level, status.message, values)
            )

    def _on_log(self, message: Log) -> None:
        self._log.append((time.monotonic(), message.name, message.level, message.msg))


def picture(message: Image) -> npt.NDArray[np.uint8] | None:
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
