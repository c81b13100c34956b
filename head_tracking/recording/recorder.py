"""Records all topics of a robot into an MCAP file, as `ros2 bag record --all` does.

The subscriptions have the quality of service that all publishers of a topic can serve. The file
has what rosbag2 writes: profile ros2, definitions of the messages, QoS of the publishers.
Format: https://mcap.dev/spec; the channels' metadata as rosbag2_storage_mcap reads them.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import threading
import time
from dataclasses import dataclass
from itertools import chain, count
from operator import itemgetter
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import Writer
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image

from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import parameter
from head_tracking.ros.kit.images import compressed_message
from head_tracking.ros.kit.message_types import message_class, message_definition
from head_tracking.ros.kit.threads import NodeBeside, take_message
from head_tracking.vision.images import ImageError
from head_tracking.vision.opencv import OpenCVMissingError

_PERIOD = 0.02  # s between polls
_DISCOVERY_PERIOD = 0.5  # s
_CHUNK = 1 << 20  # bytes
_CHUNK_PERIOD = 1.0  # s: what a crash loses at most
_PICTURE_PERIOD = 0.1  # s
_DEPTH = 200  # messages of a topic between two polls
_KEPT_FREE = 200_000_000  # bytes on the disk
_TOO_LITTLE = f"less than {_KEPT_FREE / 1e6:.0f} MB are free on the disk"
_SHARED = {"/tf", "/tf_static", "/diagnostics", "/rosout", "/parameter_events", "/clock"}
"""Topics that all robots of a graph have in common."""

_IMAGE = "sensor_msgs/msg/Image"
_COMPRESSED = "sensor_msgs/msg/CompressedImage"
_POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
_DEPTH_ENCODINGS = {"16UC1", "32FC1", "mono16"}


@dataclass(frozen=True, slots=True)
class RecorderParameters:
    """Where recordings are kept, and how large one may become."""

    record_directory: str = parameter(
        "~/head_recordings", "The folder for recordings on the robot's side.", fixed=True
    )
    record_limit: int = parameter(
        1000, "A recording ends at this size.", unit="MB", minimum=1, maximum=100_000,
        fixed=True,
    )  # fmt: skip


class Recorder:
    """Records all topics of one robot; for any thread.

    A thread of its own polls the topics and writes the messages without decoding them. Images are
    compressed, ten per second; depth images and point clouds are left out.

    Args:
        beside: the node that it belongs to; the topics of the robot are those in its namespace.
        parameters: where recordings are kept.
    """

    def __init__(self, beside: Node, parameters: RecorderParameters) -> None:
        self._beside = beside
        self._directory = Path(os.path.expanduser(parameters.record_directory))
        self._limit = parameters.record_limit * 1_000_000
        self._lock = threading.Lock()
        self._session: _Session | None = None

    @property
    def file(self) -> Path | None:
        """The file that is being written; None without one."""
        session = self._session
        return session.file if session is not None and session.runs else None

    @property
    def status(self) -> str:
        """The state of the present or last recording; empty before the first."""
        session = self._session
        return "" if session is None else session.status()

    def files(self) -> tuple[Path, ...]:
        """Return the recordings that are complete, latest first."""
        with contextlib.suppress(OSError):
            found = sorted(self._directory.glob("*.mcap"), reverse=True)
            return tuple(file for file in found if file != self.file)
        return ()

    def start(self) -> str:
        """Begin a new file; return which.

        Raises:
            HeadTrackingError: a file is being written, or none can be.
        """
        with self._lock:
            if self.file is not None:
                raise HeadTrackingError(f"{self.file} is being recorded already.")
            try:
                self._directory.mkdir(parents=True, exist_ok=True)
                if _is_disk_full(self._directory):
                    raise OSError(f"{_TOO_LITTLE} of {self._directory}")
                file = _new_file(self._directory)
                self._session = _Session(self._beside, file, self._limit)
            except OSError as error:
                raise HeadTrackingError(
                    f"Can't record: {error}. See the parameter record_directory."
                ) from error
            return f"Recording into {file}."

    def stop(self) -> str:
        """End the file, if one is being written; return its status."""
        with self._lock:
            if self._session is not None:
                self._session.close()
            return self.status


def _is_disk_full(folder: Path) -> bool:
    return shutil.disk_usage(folder).free < _KEPT_FREE


def _new_file(directory: Path) -> Path:
    name = time.strftime("head-%Y%m%d-%H%M%S")
    names = chain([name], (f"{name}-{number}" for number in count(2)))
    files = (directory / f"{one}.mcap" for one in names)
    return next(file for file in files if not file.exists())


class _Topic:
    """A subscription that is polled."""

    def __init__(self, node: Node, name: str, kind: str, endpoints: list[Any]) -> None:
        self.name, self.kind = name, kind
        self.is_image = kind == _IMAGE
        self.is_picture = kind in (_IMAGE, _COMPRESSED)
        self.channel: int | None = None
        self.polled = 0.0
        profiles = [one.qos_profile for one in endpoints]
        self.offers = [_offer(one) for one in profiles]
        self.type_hash = str(endpoints[0].topic_type_hash)
        latched = all(one.durability is DurabilityPolicy.TRANSIENT_LOCAL for one in profiles)
        reliable = all(one.reliability is ReliabilityPolicy.RELIABLE for one in profiles)
        quality = QoSProfile(
            depth=1 if self.is_picture else _DEPTH,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            reliability=ReliabilityPolicy.RELIABLE
            if reliable and not self.is_image
            else ReliabilityPolicy.BEST_EFFORT,
        )
        self.subscription = node.create_subscription(
            message_class(kind), name, lambda _: None, quality, raw=not self.is_image
        )


class _Session:
    """One file, from its first to its last message."""

    def __init__(self, beside: Node, file: Path, limit: int) -> None:
        self.file = file
        self._limit = limit
        self._base = beside.get_namespace().rstrip("/") + "/"
        self._stream = file.open("xb")
        self._writer = Writer(self._stream, chunk_size=_CHUNK)
        self._writer.start(profile="ros2", library="head_tracking")
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, _Topic] = {}
        self._left_out: dict[str, str] = {}
        self._count, self._size, self._end = 0, 0, ""
        self._started = self._ended = time.monotonic()
        self._ending = threading.Event()
        self._node = NodeBeside(beside, "recorder")
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def runs(self) -> bool:
        """Whether the file is still being written."""
        return self._thread.is_alive()

    def status(self) -> str:
        """Return duration, size, what is left out, and why the file ended."""
        seconds = (time.monotonic() if self.runs else self._ended) - self._started
        parts = [
            f"{self.file}: {seconds:.0f} s, {self._size / 1e6:.1f} MB, "
            f"{self._count} messages on {len(self._topics.keys() - self._left_out.keys())} topics"
        ]
        left_out = sorted(dict(self._left_out).items())
        if left_out:
            parts.append("left out: " + ", ".join(f"{name} ({why})" for name, why in left_out))
        return "; ".join([*parts, self._end] if self._end else parts)

    def close(self) -> None:
        """Write what has come, and end the file."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        discovery_due = chunk_due = 0.0
        try:
            while not self._ending.is_set():
                now = time.monotonic()
                if now >= discovery_due:
                    discovery_due = now + _DISCOVERY_PERIOD
                    self._discover()
                self._poll(now)
                if now >= chunk_due:
                    chunk_due = now + _CHUNK_PERIOD
                    self._writer.flush()  # type: ignore[no-untyped-call]
                    self._size = self._stream.tell()
                    if self._is_full():
                        break
                self._ending.wait(_PERIOD)
            self._poll(time.monotonic())
            self._writer.finish()  # type: ignore[no-untyped-call]
        except Exception as error:
            # a full disk, or a context that has ended: what was written up to here is kept
            self._end = f"ended by {type(error).__name__}: {error}"
        finally:
            self._ended = time.monotonic()
            with contextlib.suppress(OSError):
                self._stream.close()
                self._size = self.file.stat().st_size
            with contextlib.suppress(Exception):  # the context may have ended
                self._node.destroy_node()

    def _is_full(self) -> bool:
        if self._size >= self._limit:
            self._end = f"ended at {self._limit / 1e6:.0f} MB (record_limit)"
        elif _is_disk_full(self.file.parent):
            self._end = f"ended because {_TOO_LITTLE}"
        return bool(self._end)

    def _discover(self) -> None:
        existing = dict(self._node.get_topic_names_and_types())
        for name, kinds in existing.items():
            if name in self._topics or name in self._left_out or not self._is_wanted(name):
                continue
            kind = kinds[0]
            if kind == _POINT_CLOUD or name.endswith("/compressedDepth"):
                self._left_out[name] = "point clouds and depth images are not recorded"
                continue
            if kind == _IMAGE and _COMPRESSED in existing.get(f"{name}/compressed", ()):
                continue
            try:
                if endpoints := self._node.get_publishers_info_by_topic(name):
                    self._topics[name] = _Topic(self._node, name, kind, endpoints)
            except Exception as error:  # such as a name that only other programs of DDS allow
                self._left_out[name] = str(error)

    def _is_wanted(self, name: str) -> bool:
        hidden = any(part.startswith("_") for part in name.split("/"))
        return (name.startswith(self._base) or name in _SHARED) and not hidden

    def _poll(self, now: float) -> None:
        """Write the messages that have come, in the order of their reception."""
        received = []
        for topic in list(self._topics.values()):
            if topic.is_picture:
                if now - topic.polled < _PICTURE_PERIOD:
                    continue
                topic.polled = now
            for _ in range(1 if topic.is_picture else _DEPTH):
                taken = take_message(topic.subscription)
                if taken is None:
                    break
                message, about = taken
                data = self._compressed(topic, message) if topic.is_image else message
                if data is not None:
                    received.append((about["received_timestamp"], topic, data, about))
        for stamp, topic, data, about in sorted(received, key=itemgetter(0)):
            if topic.channel is None:
                topic.channel = self._channel(topic)
            self._count += 1
            number = about["publication_sequence_number"] or 0
            self._writer.add_message(topic.channel, stamp, data, about["source_timestamp"], number)

    def _channel(self, topic: _Topic) -> int:
        name, kind = topic.name, topic.kind
        metadata = {
            "offered_qos_profiles": yaml.dump(topic.offers, Dumper=_Dumper, sort_keys=False)
        }
        if topic.is_image:
            name, kind = f"{name}/compressed", _COMPRESSED
        else:
            metadata["topic_type_hash"] = topic.type_hash
        if kind not in self._schemas:
            definition = message_definition(kind).encode()
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition)
        return self._writer.register_channel(name, "cdr", self._schemas[kind], metadata)

    def _compressed(self, topic: _Topic, message: Image) -> bytes | None:
        """Return an image as JPEG; None if that fails."""
        try:
            if message.encoding in _DEPTH_ENCODINGS:
                raise ImageError("depth images are not recorded")
            compressed = bytes(serialize_message(compressed_message(message)))
        except (ImageError, OpenCVMissingError) as error:
            self._left_out[topic.name] = str(error)
            return None
        self._left_out.pop(topic.name, None)
        return compressed


def _offer(profile: QoSProfile) -> dict[str, Any]:
    """Return a publisher's quality of service as rosbag2 writes it (its format 9)."""

    def duration(of: Any) -> dict[str, int]:
        seconds, nanoseconds = divmod(of.nanoseconds, 1_000_000_000)
        return {"sec": seconds, "nsec": nanoseconds}

    return {
        "history": profile.history.name.lower(),
        "depth": profile.depth,
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
        "deadline": duration(profile.deadline),
        "lifespan": duration(profile.lifespan),
        "liveliness": profile.liveliness.name.lower(),
        "liveliness_lease_duration": duration(profile.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions,
    }


class _Dumper(yaml.SafeDumper):
    """Writes no anchors: other readers may not support them."""

    def ignore_aliases(self, _: Any) -> bool:
        return True
