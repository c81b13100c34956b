"""Reads MCAP files of the recorder and of `ros2 bag record` as observations of a robot."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap_ros2.decoder import DecoderFactory

from head_tracking.recording.recording import (
    ERRORS,
    Moment,
    Observation,
    Recording,
    RecordingError,
    known_joints,
    observed,
)
from head_tracking.ros.kit.diagnostics import Level
from head_tracking.ros.targets.latest_target import TransformedTarget
from head_tracking.tracking import Target, TargetPlacer
from head_tracking.transforms import (
    LATEST,
    Rotation,
    Transform,
    TransformBuffer,
    TransformException,
    parse_robot_model,
)

_MCAP = b"\x89MCAP"
_LARGEST = 200_000_000  # bytes of one chunk, decompressed
_PERIOD = 40_000_000  # ns between observations
_MOST = 20_000  # observations: a longer recording has fewer per second
_MOST_MOMENTS = 200
_ERROR_AGE = 1_000_000_000  # ns
_PATIENCE = 1.0  # s until a target's transform is recorded
_LATE = 1_000_000_000  # ns: a target that is later than this was stamped by another clock
_START = 1_000_000_000  # ns in which latched messages come, which are no events
_ERROR = 40  # rcl_interfaces/Log.ERROR
_PICTURES = 100_000_000  # bytes of pictures that are kept
_ANNOTATED = "visual_target/image"
_COMPRESSED = "sensor_msgs/msg/CompressedImage"


def read_recording(file: IO[bytes]) -> Recording:
    """Return a recording from a file, which can seek.

    A file that was cut off is read up to there, and the recording's notice reports it.

    Raises:
        RecordingError: The file is not MCAP, or nothing of it can be read.
    """
    if file.read(len(_MCAP)) != _MCAP:
        raise RecordingError("The file is not MCAP (.mcap).")
    contents = _Contents()
    # a damaged file makes its reader raise any error; the second reading finds it again
    with contextlib.suppress(Exception):
        for record in _records(file):
            contents.add(record)
    reading = _Reading(contents)
    why = ""
    try:
        for record in _records(file):
            if isinstance(record, Message):
                reading.add(record)
    except Exception as error:
        why = _why(error, file)
    return reading.recording(why)


def _why(error: Exception, file: IO[bytes]) -> str:
    """Return why a file could not be read to its end."""
    if not file.read(1):  # all of it was there, and it was not enough
        return "the file was cut off"
    return f"the file is damaged ({type(error).__name__}: {error})"


def _records(file: IO[bytes]) -> Iterator[Any]:
    """Yield all records from the beginning up to the first incomplete chunk."""
    file.seek(0)
    for record in StreamReader(file, emit_chunks=True, record_size_limit=_LARGEST).records:
        if isinstance(record, Chunk):
            yield from breakup_chunk(_decompressed(record), validate_crc=True)
        else:
            yield record


def _decompressed(chunk: Chunk) -> Chunk:
    """Return a chunk with its data decompressed, up to a size."""
    size = chunk.uncompressed_size
    if size > _LARGEST:
        raise McapError(f"a chunk of {size} bytes; the limit is {_LARGEST}")
    match chunk.compression:
        case "zstd":
            data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size)
        case _:
            data = chunk.data
    if len(data) != size:
        raise EndOfFile
    return replace(chunk, data=data, compression="")


@dataclass
class _Contents:
    """Channels and schemas of a file by number, and the first robot description of each topic."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    models: dict[str, Message] = field(default_factory=dict)

    def add(self, record: Any) -> None:
        match record:
            case Schema():
                self.schemas[record.id] = record
            case Channel():
                self.channels[record.id] = record
            case Message():
                topic = self.channels[record.channel_id].topic
                if topic.endswith("/robot_description"):
                    self.models.setdefault(topic, record)

    def kind(self, channel: Channel) -> str:
        """Return the name of a channel's message type; empty for one without a schema."""
        schema = self.schemas.get(channel.schema_id)
        return "" if schema is None else schema.name

    def decoder(self, channel: Channel) -> Callable[[bytes], Any] | None:
        """Return the decoder of a channel's messages; None: there is none."""
        schema = self.schemas.get(channel.schema_id)
        return DecoderFactory().decoder_for(channel.message_encoding, schema)

    def namespace(self) -> str:
        """Return the namespace of the robot, with a slash at its end."""
        topics = sorted((one.topic for one in self.channels.values()), key=lambda t: (len(t), t))
        for ending in ("robot_description", "joint_states"):
            for topic in topics:
                if topic.endswith(f"/{ending}"):
                    return topic.removesuffix(ending)
        return "/"

    def camera(self, namespace: str) -> str:
        """Return the topic of the pictures to show: annotated ones first; empty: none."""
        topics = [
            one.topic
            for one in self.channels.values()
            if self.kind(one) == _COMPRESSED
            and one.topic.startswith(namespace)
            and not one.topic.endswith("compressedDepth")
        ]
        return min(topics, key=lambda topic: (_ANNOTATED not in topic, topic), default="")


_STATUS = "diagnostic_msgs/msg/DiagnosticStatus"


class _Reading:
    """Makes observations from a file's messages.

    Times are those of the recording, which one clock has measured.
    """

    def __init__(self, contents: _Contents) -> None:
        self._contents = contents
        self._period = _PERIOD
        self._base = base = contents.namespace()
        self._camera = contents.camera(base)
        self._buffer = TransformBuffer()
        self._no_model = ""
        description = contents.models.get(f"{base}robot_description")
        if description is not None:
            try:
                decode = contents.decoder(contents.channels[description.channel_id])
                if decode is not None:
                    self._buffer.set_model(parse_robot_model(decode(description.data).data))
            except Exception as error:  # a wrong schema makes any error
                self._no_model = f"its robot_description is invalid: {error}"
        root = self._buffer.model.root if self._buffer.model else ""
        self._placer = TargetPlacer(self._buffer, root, _PATIENCE)
        self._seen: list[Observation] = []
        self._moments: list[tuple[int, str]] = []
        self._first: int | None = None
        self._now = self._due = 0
        self._joint_stamp = 0
        self._target: TransformedTarget | None = None  # the latest that could be transformed
        self._latest: dict[str, tuple[int, Any]] = {"stopped": (0, False)}  # when, and the value
        self._levels: dict[str, int] = {}
        self._pictures: list[tuple[int, bytes]] = []  # stamp, and JPEG or PNG
        self._picture_bytes, self._picture_period = 0, 0
        self._unread: dict[str, str] = {}  # why messages can't be read, by topic
        self._handlers: dict[int, Callable[[bytes], None] | None] = {}  # by number of the channel

    def _handler(self, channel: Channel) -> Callable[[bytes], None] | None:
        """Return what handles the messages of a channel; None: they are ignored."""
        kind, topic = self._contents.kind(channel), channel.topic
        name = topic.removeprefix(self._base)
        handlers: dict[tuple[str, str], Callable[[Any], None]] = {
            (f"{self._base}joint_states", "sensor_msgs/msg/JointState"): self._on_joints,
            ("/tf", "tf2_msgs/msg/TFMessage"): self._on_transforms,
            ("/tf_static", "tf2_msgs/msg/TFMessage"): partial(self._on_transforms, static=True),
            (f"{self._base}target_point", "geometry_msgs/msg/PointStamped"): self._on_target,
            ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"): self._on_diagnostics,
            ("/rosout", "rcl_interfaces/msg/Log"): self._on_log,
            (self._camera, _COMPRESSED): self._on_picture,
        }
        handle = handlers.get((topic, kind))
        is_kept = {
            "std_msgs/msg/Bool": name == "stopped" or name.endswith("/enabled"),
            "std_msgs/msg/Float64": name in ERRORS.values(),
            _STATUS: name.removesuffix("/status") in ERRORS,
        }
        if name != topic and is_kept.get(kind):
            handle = partial(self._keep, name)
        decode = None if handle is None else self._contents.decoder(channel)
        if handle is None or decode is None:
            return None
        return lambda data: handle(decode(data))

    def add(self, message: Message) -> None:
        if self._first is None:
            self._first = self._now = self._due = message.log_time
        if self._due <= self._now < message.log_time:
            self._observe()  # all that was recorded before
            self._due = self._now + self._period
        self._now = max(self._now, message.log_time)
        number = message.channel_id
        channel = self._contents.channels[number]
        try:
            if number not in self._handlers:
                self._handlers[number] = None
                self._handlers[number] = self._handler(channel)
            handle = self._handlers[number]
            if handle is not None:
                handle(message.data)
        except Exception as error:  # a wrong schema or message makes any error
            self._unread[channel.topic] = f"{type(error).__name__}: {error}"

    def recording(self, why: str) -> Recording:
        """Return the recording of a file that ended too early for a reason; empty: it did not.

        Raises:
            RecordingError: there is no observation.
        """
        if self._first is not None:
            self._observe()
        unread = "; ".join(f"{topic} can't be read ({e})" for topic, e in self._unread.items())
        model = self._buffer.model
        if model is None or not self._seen:
            missing = f"no joint_states in {self._base}" if model else "no robot_description"
            reason = why or self._no_model or unread or missing
            raise RecordingError(f"Nothing of the file can be shown: {reason}.")
        start = self._seen[0].stamp
        moments = (Moment((at - start) * 1e-9, text) for at, text in self._moments)
        return Recording(
            tuple(self._seen),
            model,
            tuple(moments),
            "; ".join(filter(None, (f"{why}; it is shown up to there" if why else "", unread))),
            tuple(self._pictures),
        )

    def _observe(self) -> None:
        model = self._buffer.model
        if model is None or not (self._seen or known_joints(self._buffer, model)):
            return  # the recording begins with the first measurement of the robot
        for target, point in self._placer.place(self._now * 1e-9, {}, latest_only=True):
            self._target = TransformedTarget(target, point, target.stamp or self._now)
        statuses = {node: self._value(f"{node}/status") or {} for node in ERRORS}
        enabled = {node: self._value(f"{node}/enabled") for node in ERRORS}
        on = (n for n in ERRORS if enabled[n] or (enabled[n] is None and statuses[n]))
        controller = next(on, "")
        status = statuses.get(controller, {})
        if self._value("stopped"):
            status = {"state": "stopped"}
        error = self._value(ERRORS.get(controller, ""), self._now - _ERROR_AGE)
        seen = observed(
            self._now,
            self._buffer,
            model,
            self._target,
            error,
            controller,
            status,
        )
        if self._seen and seen.joints == self._seen[-1].joints:
            seen = replace(seen, joints=self._seen[-1].joints)  # equal ones share one dict
        self._seen.append(seen)
        if len(self._seen) > _MOST:
            self._seen, self._period = self._seen[::2], 2 * self._period

    def _on_joints(self, message: Any) -> None:
        self._joint_stamp = _stamp(message.header)
        positions = dict(zip(message.name, message.position, strict=False))
        try:
            self._buffer.set_joint_positions(self._now, positions)
        except TransformException:
            return  # as a live robot refuses it

    def _on_transforms(self, message: Any, *, static: bool = False) -> None:
        for one in message.transforms:
            t, r = one.transform.translation, one.transform.rotation
            place = Transform((t.x, t.y, t.z), Rotation(r.x, r.y, r.z, r.w))
            with contextlib.suppress(TransformException):
                self._buffer.set_transform(
                    self._now, one.header.frame_id, one.child_frame_id, place, static=static
                )

    def _on_target(self, message: Any) -> None:
        point = (message.point.x, message.point.y, message.point.z)
        sent = _stamp(message.header)
        late = self._joint_stamp - sent if self._joint_stamp else 0
        stamp = self._now - (late if 0 < late < _LATE else 0) if sent else LATEST
        self._placer.offer(Target(stamp, message.header.frame_id, point), self._now * 1e-9)

    def _keep(self, topic: str, message: Any) -> None:
        is_status = topic.endswith("/status")
        now = {each.key: each.value for each in message.values} if is_status else message.data
        before = self._value(topic)
        if isinstance(now, bool) and now is not before:
            node = topic.removesuffix("/enabled")
            is_stop = topic == "stopped"
            self._mark(("resume", "STOP")[now] if is_stop else f"{node} {('off', 'on')[now]}")
        self._latest[topic] = self._now, now

    def _value(self, topic: str, since: float = -math.inf) -> Any:
        """Return the latest value of a topic; None if there is none, or it is older."""
        at, value = self._latest.get(topic, (-math.inf, None))
        return value if at >= since else None

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            level = int(status.level)
            if level == Level.ERROR and self._levels.get(status.name) != level:
                self._mark(f"{status.name}: {status.message}")
            self._levels[status.name] = level

    def _on_log(self, message: Any) -> None:
        if message.level >= _ERROR:
            self._mark(f"{message.name}: {message.msg}")

    def _on_picture(self, message: Any) -> None:
        """Keep pictures: the longer the recording, the fewer per second."""
        if self._pictures and self._now < self._pictures[-1][0] + self._picture_period:
            return
        self._pictures.append((self._now, bytes(message.data)))
        self._picture_bytes += len(message.data)
        if self._picture_bytes > _PICTURES:
            length = self._now - self._pictures[0][0]
            self._picture_period = 2 * length // len(self._pictures)
            self._pictures = self._pictures[::2]
            self._picture_bytes = sum(len(picture) for _, picture in self._pictures)

    def _mark(self, text: str) -> None:
        start = self._seen[0].stamp if self._seen else self._now
        if len(self._moments) < _MOST_MOMENTS and self._now - start > _START:
            self._moments.append((self._now, text))


def _stamp(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
