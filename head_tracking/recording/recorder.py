"""Everything that a robot says, written into an MCAP file as `ros2 bag record` would.

Topics are looked at as `ros2 bag record --all` does, with the quality of service that all of a
topic's publishers can serve.
"""

from __future__ import annotations

import contextlib
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CompressedImage, Image

from head_tracking.parameters import parameter
from head_tracking.recording.bag_writer import (
    LATCHED_OFFER,
    OFFER,
    BagWriter,
    offer,
    transforms_of_joints,
)
from head_tracking.ros.kit.images import picture_of
from head_tracking.ros.kit.message_types import message_class
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.transforms import RobotModel, TransformBuffer
from head_tracking.vision.images import ImageError
from head_tracking.vision.opencv import OpenCVMissingError, cv2

_PERIOD = 0.02  # s between looks at what has come
_LOOK_PERIOD = 0.5  # s
_FRAMES_PERIOD = 0.05  # s
_CHUNK_PERIOD = 1.0  # s: what a crash loses at most
_PICTURE_PERIOD = 0.1  # s
_JPEG_QUALITY = 80
_DEPTH = 200  # messages of a topic between two looks
_KEPT_FREE = 200_000_000  # bytes on the disk
_SHARED = {"/tf", "/tf_static", "/diagnostics", "/rosout", "/parameter_events", "/clock"}
"""Topics that all robots of a graph have in common."""

_IMAGE = "sensor_msgs/msg/Image"
_COMPRESSED = "sensor_msgs/msg/CompressedImage"
_TOO_MUCH = {"sensor_msgs/msg/PointCloud2"}
_DEPTHS = {"16UC1", "32FC1", "mono16"}


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

    The topics are looked at by a thread of its own, from a node that no executor spins: what
    comes is written as it came, without being looked into. Pictures are compressed, ten a second;
    depth pictures and point clouds are left out.

    Args:
        beside: the node that it belongs to.
        belongs: whether a topic, by its full name, is this robot's.
        parameters: where to, and how much; read at each start.
        buffer: the robot's frames, which go on /tf where nobody publishes them.
        values: the parameters of all nodes, by node and name, which are put beside the messages.
    """

    def __init__(
        self,
        beside: Node,
        belongs: Callable[[str], bool],
        parameters: RecorderParameters,
        buffer: TransformBuffer,
        values: Callable[[], Mapping[str, Mapping[str, Any]]],
    ) -> None:
        self._parameters = parameters
        self._begin = partial(_Session, beside, belongs, buffer, values)
        self._lock = threading.Lock()
        self._session: _Session | None = None

    @property
    def directory(self) -> Path:
        """Where recordings are."""
        folder = Path(self._parameters.record_directory)
        try:
            return folder.expanduser()
        except RuntimeError:
            return folder  # there is no home: it can't be written, and that is said

    @property
    def file(self) -> Path | None:
        """What is written now."""
        session = self._session
        return session.file if session is not None and session.runs else None

    @property
    def status(self) -> str:
        """What is recorded, or was last, and how that ended; empty before the first."""
        session = self._session
        return "" if session is None else session.status()

    def files(self) -> tuple[Path, ...]:
        """The recordings that are there, newest first."""
        with contextlib.suppress(OSError):
            return tuple(sorted(self.directory.glob("*.mcap"), reverse=True))
        return ()

    def start(self) -> Outcome:
        """Begins a new file."""
        with self._lock:
            if self.file is not None:
                return Outcome(False, f"{self.file} is recorded already")
            try:
                self.directory.mkdir(parents=True, exist_ok=True)
                file = _new_file(self.directory)
                self._session = self._begin(file, self._parameters.record_limit * 1_000_000)
            except OSError as error:
                return Outcome(
                    False, f"nothing is recorded: {error}; see the parameter record_directory"
                )
            return Outcome(True, f"records into {file}")

    def stop(self) -> Outcome:
        """Ends the file."""
        with self._lock:
            session = self._session
            if session is None or not session.runs:
                return Outcome(False, "nothing is recorded now")
            session.close()
            return Outcome(True, session.status())

    def close(self) -> None:
        """Ends the file, if there is one."""
        if self.file is not None:
            self.stop()


def _new_file(directory: Path) -> Path:
    """A name that is not taken yet."""
    name = time.strftime("head-%Y%m%d-%H%M%S")
    for ending in ("", *(f"-{number}" for number in range(2, 100))):
        file = directory / f"{name}{ending}.mcap"
        if not file.exists():
            return file
    raise FileExistsError(f"{directory} is full of recordings of this second")


class _Topic:
    """A topic that is listened to, until its messages are taken.

    Args:
        node: listens.
        name: of the topic.
        kind: the name of its type.
        endpoints: who publishes on it.

    Raises:
        LookupError: the package of its type is not installed.
    """

    def __init__(self, node: Node, name: str, kind: str, endpoints: list[Any]) -> None:
        self.name, self.kind = name, kind
        self.picture = kind == _IMAGE
        self.channel: int | None = None
        self.taken = 0.0
        offers = [one.qos_profile for one in endpoints]
        self.offers = [offer(one) for one in offers]
        self.type_hash = str(endpoints[0].topic_type_hash)
        # as every publisher can serve it
        latched = all(one.durability is DurabilityPolicy.TRANSIENT_LOCAL for one in offers)
        reliable = all(one.reliability is ReliabilityPolicy.RELIABLE for one in offers)
        self._subscription = node.create_subscription(
            message_class(kind),
            name,
            _nothing,
            QoSProfile(
                depth=1 if self.picture else 10 if kind == _COMPRESSED else _DEPTH,
                durability=DurabilityPolicy.TRANSIENT_LOCAL
                if latched
                else DurabilityPolicy.VOLATILE,
                reliability=ReliabilityPolicy.RELIABLE
                if reliable and not self.picture
                else ReliabilityPolicy.BEST_EFFORT,
            ),
            raw=not self.picture,
        )

    def take(self) -> tuple[Any, dict[str, Any]] | None:
        """The next message, if one has come, with what the middleware knows of it."""
        subscription = self._subscription
        with subscription.handle:
            taken: tuple[Any, dict[str, Any]] | None = subscription.handle.take_message(
                subscription.msg_type, subscription.raw
            )
        return taken


class _Session:
    """One file, from its first to its last message."""

    def __init__(
        self,
        beside: Node,
        belongs: Callable[[str], bool],
        buffer: TransformBuffer,
        values: Callable[[], Mapping[str, Mapping[str, Any]]],
        file: Path,
        limit: int,
    ) -> None:
        self.file = file
        self._belongs = belongs
        self._buffer = buffer
        self._model: RobotModel | None = None
        self._frames: tuple[int, int] | None = None
        self._values = values
        self._limit = limit
        self._stream = file.open("xb")
        self._bag = BagWriter(self._stream)
        self._topics: dict[str, _Topic] = {}
        self._left_out: dict[str, str] = {}
        self._count, self._size, self._end = 0, 0, ""
        self._started = self._ended = time.monotonic()
        self._ending = threading.Event()
        self._node = Node(
            f"{beside.get_name()}_recorder",
            namespace=beside.get_namespace(),
            context=beside.context,
            start_parameter_services=False,
        )
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def runs(self) -> bool:
        """Whether it is still written."""
        return self._thread.is_alive()

    def status(self) -> str:
        """How much there is, what is left out, and why it ended."""
        until = time.monotonic() if self.runs else self._ended
        left_out = ", ".join(
            f"{name} ({why})" for name, why in sorted(dict(self._left_out).items())
        )
        return (
            f"{self.file}: {until - self._started:.0f} s, {self._size / 1e6:.1f} MB, "
            f"{self._count} messages on {len(self._topics)} topics"
            + (f"; left out: {left_out}" if left_out else "")
            + (f"; {self._end}" if self._end else "")
        )

    def close(self) -> None:
        """Ends it, with all that has come."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        next_look = next_chunk = next_frames = 0.0
        attached: dict[str, Any] = {}
        try:
            while not self._ending.is_set():
                now = time.monotonic()
                if now >= next_look:
                    next_look = now + _LOOK_PERIOD
                    self._look()
                self._take(now)
                if now >= next_frames:
                    next_frames = now + _FRAMES_PERIOD
                    self._write_frames()
                if now >= next_chunk:
                    next_chunk = now + _CHUNK_PERIOD
                    attached = self._attach(attached)
                    self._bag.flush()
                    self._size = self._stream.tell()
                    if self._is_full():
                        break
                self._ending.wait(_PERIOD)
            self._take(time.monotonic())
            self._attach(attached)
            self._bag.finish()
        except Exception as error:
            # a full disk, a context that has ended: what was written up to here stays
            self._end = f"it ended by itself: {type(error).__name__}: {error}"
        finally:
            self._ended = time.monotonic()
            with contextlib.suppress(OSError):
                self._stream.close()
                self._size = self.file.stat().st_size
            with contextlib.suppress(Exception):  # the context may have ended
                self._node.destroy_node()

    def _is_full(self) -> bool:
        if self._size >= self._limit:
            self._end = f"it ended at {self._limit / 1e6:.0f} MB (record_limit)"
        elif shutil.disk_usage(self.file.parent).free < _KEPT_FREE:
            self._end = f"it ended: less than {_KEPT_FREE / 1e6:.0f} MB are free on the disk"
        return bool(self._end)

    def _look(self) -> None:
        """Listens to what has appeared."""
        there = dict(self._node.get_topic_names_and_types())
        for name, kinds in there.items():
            if name in self._topics or name in self._left_out or not self._is_wanted(name):
                continue
            kind = kinds[0]
            if kind in _TOO_MUCH:
                self._left_out[name] = "point clouds are too much"
                continue
            if kind == _IMAGE and _COMPRESSED in there.get(f"{name}/compressed", ()):
                continue
            endpoints = self._node.get_publishers_info_by_topic(name)
            if not endpoints:
                continue
            try:
                self._topics[name] = _Topic(self._node, name, kind, endpoints)
            except LookupError as error:
                self._left_out[name] = str(error)

    def _is_wanted(self, name: str) -> bool:
        hidden = any(part.startswith("_") for part in name.split("/"))
        return (self._belongs(name) or name in _SHARED) and not hidden

    def _take(self, now: float) -> None:
        """Writes what has come, in the order in which it came."""
        come = []
        for topic in list(self._topics.values()):
            if topic.picture:
                if now - topic.taken < _PICTURE_PERIOD:
                    continue
                topic.taken = now
            for _ in range(1 if topic.picture else _DEPTH):
                taken = topic.take()
                if taken is None:
                    break
                message, about = taken
                data = self._compressed(topic, message) if topic.picture else message
                if data is not None:
                    come.append((about["received_timestamp"], topic, data, about))
        come.sort(key=itemgetter(0))
        for stamp, topic, data, about in come:
            if topic.channel is None:
                topic.channel = self._channel(topic)
            self._count += 1
            self._bag.write_encoded(
                topic.channel,
                stamp,
                about["source_timestamp"],
                data,
                about["publication_sequence_number"] or 0,
            )

    def _write_frames(self) -> None:
        """Writes the frames of the robot where nobody publishes them (without tf2_msgs)."""
        model = self._buffer.model
        if model is None or "/tf" in self._topics or "/tf_static" in self._topics:
            return
        if self._frames is None:
            kind = "tf2_msgs/msg/TFMessage"
            self._frames = (
                self._bag.channel("/tf_static", kind, [LATCHED_OFFER]),
                self._bag.channel("/tf", kind, [OFFER]),
            )
        now = time.time_ns()
        for channel, moving in zip(self._frames, (False, True), strict=True):
            if moving or model is not self._model:
                found = transforms_of_joints(self._buffer, now, moving=moving)
                self._bag.write(channel, now, {"transforms": found})
        self._model = model

    def _channel(self, topic: _Topic) -> int:
        if topic.picture:
            return self._bag.channel(f"{topic.name}/compressed", _COMPRESSED, topic.offers)
        return self._bag.channel(topic.name, topic.kind, topic.offers, topic.type_hash)

    def _compressed(self, topic: _Topic, message: Image) -> bytes | None:
        """A picture as JPEG; None for what is none: its topic is left out from then on."""
        try:
            if message.encoding in _DEPTHS:
                raise ImageError("depth pictures are too much")
            picture = picture_of(message).bgr
            done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
            if not done:
                raise ImageError("it can't be compressed")
        except (ImageError, OpenCVMissingError) as error:
            self._left_out[topic.name] = str(error)
            del self._topics[topic.name]
            return None
        compressed = CompressedImage(
            header=message.header, format=f"{message.encoding}; jpeg compressed bgr8"
        )
        compressed.data.frombytes(data.tobytes())
        return bytes(serialize_message(compressed))

    def _attach(self, before: Mapping[str, Any]) -> dict[str, Any]:
        """Puts the parameters of nodes that are new into the file, as `--params-file` takes them.

        Later changes are on /parameter_events.
        """
        values = {name: dict(found) for name, found in self._values().items()}
        if values.keys() <= before.keys():
            return dict(before)
        now = time.time_ns()
        text = yaml.safe_dump({name: {"ros__parameters": values[name]} for name in sorted(values)})
        self._bag.attach(now, "parameters.yaml", "application/yaml", text)
        return values


def _nothing(_: Any) -> None:
    """No executor calls it."""
