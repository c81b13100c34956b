"""Recordings as MCAP files: the page's own, and those of `ros2 bag record`."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap_ros2.decoder import DecoderFactory

from head_tracking.recording.bag_writer import (
    LATCHED_OFFER,
    OFFER,
    BagWriter,
    header,
    transform_of,
    transforms_of_joints,
    xyz,
)
from head_tracking.recording.recording import (
    ERRORS,
    Moment,
    Observation,
    RecordedPicture,
    Recording,
    RecordingError,
    known_joints,
    outer_frames,
)
from head_tracking.ros.kit.diagnostics import Level
from head_tracking.tracking import Target
from head_tracking.transforms import (
    LATEST,
    RobotModelError,
    Rotation,
    Transform,
    TransformBuffer,
    TransformException,
    Vector3,
    parse_robot_model,
)

_MCAP = b"\x89MCAP"
_LARGEST = 200_000_000  # bytes of one chunk, unpacked
_PERIOD = 0.04  # s
_MOST = 20_000  # observations: a longer recording is shown in fewer pictures a second
_MOST_MOMENTS = 200
_TARGET_AGE, _ERROR_AGE = 2_000_000_000, 1_000_000_000  # ns
_LATE = 1_000_000_000  # ns: a target that is later than this was stamped by another clock
_START = 1_000_000_000  # ns in which what is latched comes
_ERROR = 40  # rcl_interfaces/Log.ERROR
_PICTURES = 100_000_000  # bytes
_FOUND = "visual_target/image"
"""With what was found drawn into it: shown first, as of the robot itself."""

_COMPRESSED = "sensor_msgs/msg/CompressedImage"


def read_recording(file: IO[bytes]) -> Recording:
    """Return a recording from a file, which can seek.

    A file that was cut off opens up to there, and the recording's notice reports it.

    Raises:
        RecordingError: The file is not MCAP, or nothing of it can be read.
    """
    if file.read(len(_MCAP)) != _MCAP:
        raise RecordingError("the file is not MCAP (.mcap)")
    overview = _Overview(file)
    length = (overview.end - overview.start) * 1e-9
    reading = _Reading(overview, max(_PERIOD, length / _MOST))
    try:
        for record in _records(file):
            if isinstance(record, Message):
                reading.take(record)
    except Exception as error:
        # what a damaged file makes of its reader can't be foreseen
        return reading.recording(_in_words(error, file))
    return reading.recording("")


def _in_words(error: Exception, file: IO[bytes]) -> str:
    """Why a file ends too early."""
    if not file.read(1):  # all of it was there, and it was not enough
        return "the file was cut off"
    return f"the file is damaged ({type(error).__name__}: {error})"


def _records(file: IO[bytes]) -> Iterator[Any]:
    """All records from the beginning, chunk by chunk, up to the first that is not whole."""
    file.seek(0)
    for record in StreamReader(file, emit_chunks=True, record_size_limit=_LARGEST).records:
        if isinstance(record, Chunk):
            yield from breakup_chunk(_unpacked(record), validate_crc=True)
        else:
            yield record


def _unpacked(chunk: Chunk) -> Chunk:
    """A chunk with its data unpacked, however much that claims to be."""
    size = chunk.uncompressed_size
    if size > _LARGEST:
        raise McapError(f"a chunk of {size} bytes; up to {_LARGEST} are taken")
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


class _Overview:
    """What a file has, as far as it is whole.

    Attributes:
        channels: by number.
        schemas: by number.
        start, end: the times of the first and the last message [ns].
        namespace: of the robot, with a slash at its end.
        urdf: the first model of that robot; empty if there is none.
        camera: the topic of pictures to show first; empty if there are none.

    Raises:
        RecordingError: The file has no message.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.start, self.end = 0, 0
        texts: dict[str, str] = {}
        try:
            for record in _records(file):
                match record:
                    case Schema():
                        self.schemas[record.id] = record
                    case Channel():
                        self.channels[record.id] = record
                    case Message():
                        self.start = min(self.start or record.log_time, record.log_time)
                        self.end = max(self.end, record.log_time)
                        topic = self.channels[record.channel_id].topic
                        if topic.endswith("/robot_description") and topic not in texts:
                            texts[topic] = self._text(record)
        except Exception as error:
            if not self.end:
                raise RecordingError(
                    f"nothing of the file can be read: {_in_words(error, file)}"
                ) from error
        topics = [channel.topic for channel in self.channels.values()]
        endings = ("robot_description", "joint_states")
        bases = [
            topic.removesuffix(ending)
            for ending in endings
            for topic in sorted(topics, key=lambda topic: (len(topic), topic))
            if topic.endswith(f"/{ending}")
        ]
        self.namespace = next(iter(bases), "/")
        self.urdf = texts.get(f"{self.namespace}robot_description", "")
        cameras = [
            channel.topic
            for channel in self.channels.values()
            if self._kind(channel) == _COMPRESSED
            and channel.topic.startswith(self.namespace)
            and not channel.topic.endswith("compressedDepth")
        ]
        self.camera = min(cameras, key=lambda topic: (_FOUND not in topic, topic), default="")

    def _kind(self, channel: Channel) -> str:
        """Return the name of a channel's message type; empty for one without a schema."""
        schema = self.schemas.get(channel.schema_id)
        return "" if schema is None else schema.name

    def _text(self, message: Message) -> str:
        channel = self.channels[message.channel_id]
        if self._kind(channel) != "std_msgs/msg/String":
            return ""
        schema = self.schemas[channel.schema_id]
        decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
        return "" if decode is None else str(decode(message.data).data)


class _Reading:
    """Follows a file's messages as the page follows a robot, and keeps what it sees.

    All is put at the time at which it was recorded, which one clock has told.
    """

    def __init__(self, overview: _Overview, period: float) -> None:
        self._overview = overview
        self._period = round(period * 1e9)
        self._decoders = DecoderFactory()
        self._buffer = TransformBuffer()
        self._no_model = ""
        if overview.urdf:
            try:
                self._buffer.set_model(parse_robot_model(overview.urdf))
            except RobotModelError as error:
                self._no_model = f"its robot_description can't be used: {error}"
        self._seen: list[Observation] = []
        self._moments: list[tuple[int, str]] = []
        self._first: int | None = None
        self._now = self._next = 0
        self._joint_stamp = 0
        self._unplaced: tuple[int, Target] | None = None
        self._target: tuple[int, Target, Vector3, int] | None = None
        self._latest: dict[str, tuple[int, Any]] = {"stopped": (0, False)}  # when, and what
        self._levels: dict[str, int] = {}
        self._joints: Mapping[str, float] = {}
        self._handlers: dict[int, tuple[Callable[[Any], None], Callable[[bytes], Any]] | None] = {}
        base = overview.namespace
        self._takers: dict[tuple[str, str], Callable[[Any], None]] = {
            (f"{base}joint_states", "sensor_msgs/msg/JointState"): self._take_joints,
            ("/tf", "tf2_msgs/msg/TFMessage"): self._take_transforms,
            ("/tf_static", "tf2_msgs/msg/TFMessage"): self._take_static_transforms,
            (f"{base}target_point", "geometry_msgs/msg/PointStamped"): self._take_target,
            (f"{base}stopped", "std_msgs/msg/Bool"): self._keeper("stopped"),
            ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"): self._take_diagnostics,
            ("/rosout", "rcl_interfaces/msg/Log"): self._take_log,
        }
        for node, error_topic in ERRORS.items():
            for topic, kind in ((error_topic, "Float64"), (f"{node}/state", "String")):
                self._takers[base + topic, f"std_msgs/msg/{kind}"] = self._keeper(topic)
        self._pictures: list[RecordedPicture] = []
        self._picture_bytes, self._picture_period = 0, 0
        self._camera = overview.camera
        self._takers[self._camera, _COMPRESSED] = self._take_picture
        for channel in overview.channels.values():
            topic = channel.topic.removeprefix(base)
            if topic != channel.topic and topic.endswith("/enabled"):
                self._takers[channel.topic, "std_msgs/msg/Bool"] = self._keeper(topic)

    def take(self, message: Message) -> None:
        """Takes the next message."""
        number = message.channel_id
        if number not in self._handlers:
            self._handlers[number] = self._handler(number)
        handler = self._handlers[number]
        if self._first is None:
            self._first = self._now = self._next = message.log_time
        if self._next <= self._now < message.log_time:
            self._look()  # with all that came until then
            self._next = self._now + self._period
        self._now = max(self._now, message.log_time)
        if handler is not None:
            take, decode = handler
            take(decode(message.data))

    def recording(self, why: str) -> Recording:
        """What was seen.

        Args:
            why: the reason for which the file ended too early; empty if it did not.

        Raises:
            RecordingError: that is nothing.
        """
        if self._first is not None:
            self._look()
        if not self._seen:
            lacking = self._no_model or (
                f"there are no joint_states in {self._overview.namespace}"
                if self._overview.urdf
                else "there is no robot_description in it"
            )
            raise RecordingError(f"nothing of the file can be shown: {why or lacking}")
        notice = f"{why}; it is shown up to there" if why else ""
        start = self._seen[0].stamp
        moments = (Moment((at - start) * 1e-9, text) for at, text in self._moments)
        return Recording(
            tuple(self._seen),
            self._overview.urdf,
            tuple(moments),
            notice,
            self._camera if self._pictures else "",
            tuple(self._pictures),
        )

    def _handler(self, number: int) -> tuple[Callable[[Any], None], Callable[[bytes], Any]] | None:
        channel = self._overview.channels[number]
        schema = self._overview.schemas.get(channel.schema_id)
        take = None if schema is None else self._takers.get((channel.topic, schema.name))
        if take is None:
            return None
        decode = self._decoders.decoder_for(channel.message_encoding, schema)
        return None if decode is None else (take, decode)

    def _look(self) -> None:
        model = self._buffer.model
        if model is None:
            return
        now, target = self._now, self._placed()
        joints = known_joints(self._buffer, model)
        if not joints and not self._seen:
            return  # it begins when the robot is seen first
        if joints != self._joints:
            self._joints = joints  # else the one before is kept, and no room needed
        states = {node: self._value(f"{node}/state") for node in ERRORS}
        enabled = {node: self._value(f"{node}/enabled") for node in ERRORS}
        on = [n for n in ERRORS if enabled[n] or (enabled[n] is None and states[n] is not None)]
        turner = on[0] if on else ""
        if target is not None and turner != "point_head" and now - target[0] > _TARGET_AGE:
            target = None
        state = "stopped" if self._value("stopped") else states.get(turner) or ""
        self._seen.append(
            Observation(
                now,
                self._joints,
                outer_frames(self._buffer, model),
                None if target is None else target[2],
                "" if target is None else str(target[1]),
                self._value(ERRORS.get(turner, ""), now - _ERROR_AGE),
                f"{turner}: {state}" if turner and state else state,
                None if target is None else target[3],
            )
        )

    def _placed(self) -> tuple[int, Target, Vector3, int] | None:
        """The newest target: when it came, what was sent, where it is, when it was there."""
        model = self._buffer.model
        if self._unplaced is not None and model is not None:
            came, target = self._unplaced
            late = self._joint_stamp - target.stamp if target.stamp and self._joint_stamp else 0
            stamp = came - (late if 0 < late < _LATE else 0)
            for time in (stamp, LATEST):
                try:
                    point = self._buffer.transform_point(
                        target.point, model.root, target.frame_id, time
                    )
                except TransformException:
                    continue
                self._target = came, target, point, stamp
                self._unplaced = None
                break
        return self._target

    # Messages

    def _take_joints(self, message: Any) -> None:
        self._joint_stamp = _stamp(message.header)
        positions = dict(zip(message.name, message.position, strict=False))
        try:
            self._buffer.set_joint_positions(self._now, positions)
        except TransformException:
            return  # the page refuses it as well

    def _take_transforms(self, message: Any, *, static: bool = False) -> None:
        for one in message.transforms:
            t, r = one.transform.translation, one.transform.rotation
            try:
                self._buffer.set_transform(
                    self._now,
                    one.header.frame_id,
                    one.child_frame_id,
                    Transform((t.x, t.y, t.z), Rotation.from_quaternion_xyzw([r.x, r.y, r.z, r.w])),
                    static=static,
                )
            except (TransformException, ValueError):
                continue

    def _take_static_transforms(self, message: Any) -> None:
        self._take_transforms(message, static=True)

    def _take_target(self, message: Any) -> None:
        point = (message.point.x, message.point.y, message.point.z)
        if all(map(math.isfinite, point)):
            target = Target(_stamp(message.header), message.header.frame_id, point)
            self._unplaced = self._now, target

    def _keeper(self, topic: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            before, now = self._value(topic), message.data
            if isinstance(now, bool) and now is not before:
                switched = topic.removesuffix("/enabled"), ("off", "on")[now]
                self._mark(("resume", "STOP")[now] if topic == "stopped" else " ".join(switched))
            self._latest[topic] = self._now, now

        return keep

    def _value(self, topic: str, since: float = -math.inf) -> Any:
        """Return the latest value of a topic, unless it is older; None if there is none."""
        at, value = self._latest.get(topic, (-math.inf, None))
        return value if at >= since else None

    def _take_diagnostics(self, message: Any) -> None:
        for status in message.status:
            level = int(status.level)
            if level == Level.ERROR and self._levels.get(status.name) != level:
                self._mark(f"{status.name}: {status.message}")
            self._levels[status.name] = level

    def _take_log(self, message: Any) -> None:
        if message.level >= _ERROR:
            self._mark(f"{message.name}: {message.msg}")

    def _take_picture(self, message: Any) -> None:
        """Keeps pictures, fewer a second the longer the recording is."""
        if self._pictures and self._now < self._pictures[-1].stamp + self._picture_period:
            return
        picture = RecordedPicture(self._now, message.header.frame_id, bytes(message.data))
        self._pictures.append(picture)
        self._picture_bytes += len(picture.data)
        if self._picture_bytes > _PICTURES:
            length = self._now - self._pictures[0].stamp
            self._picture_period = 2 * length // len(self._pictures)
            self._pictures = self._pictures[::2]
            self._picture_bytes = sum(len(one.data) for one in self._pictures)

    def _mark(self, text: str) -> None:
        """Notes a moment; at the start what is latched is not one."""
        start = self._seen[0].stamp if self._seen else self._now
        if len(self._moments) < _MOST_MOMENTS and self._now - start > _START:
            self._moments.append((self._now, text))


def _stamp(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def write_recording(recording: Recording) -> bytes:
    """A recording as an MCAP file: what the page saw, on the topics that tell it."""
    stream = io.BytesIO()
    bag = BagWriter(stream)
    description = bag.channel("/robot_description", "std_msgs/msg/String", [LATCHED_OFFER])
    joints = bag.channel("/joint_states", "sensor_msgs/msg/JointState", [OFFER])
    transforms = bag.channel("/tf", "tf2_msgs/msg/TFMessage", [OFFER])
    target = bag.channel("/target_point", "geometry_msgs/msg/PointStamped", [OFFER])
    nodes = {
        node: (
            bag.channel(f"/{error}", "std_msgs/msg/Float64", [OFFER]),
            bag.channel(f"/{node}/state", "std_msgs/msg/String", [LATCHED_OFFER]),
            bag.channel(f"/{node}/enabled", "std_msgs/msg/Bool", [LATCHED_OFFER]),
        )
        for node, error in ERRORS.items()
    }
    model = parse_robot_model(recording.urdf) if recording.urdf else None
    root = "base_link" if model is None else model.root
    buffer = TransformBuffer()
    if model is not None:
        buffer.set_model(model)
        bag.write(description, recording.seen[0].stamp, {"data": recording.urdf})
    was_on: str | None = None
    states: dict[str, str] = {}
    for seen in recording.seen:
        stamp = seen.stamp
        names, positions = list(seen.joints), list(seen.joints.values())
        bag.write(
            joints, stamp, {"header": header(stamp, ""), "name": names, "position": positions}
        )
        buffer.set_joint_positions(stamp, seen.joints)
        frames = [transform_of(stamp, root, name, found) for name, found in seen.frames.items()]
        bag.write(transforms, stamp, {"transforms": frames + transforms_of_joints(buffer, stamp)})
        if seen.target is not None:
            at = header(stamp, root)
            bag.write(target, stamp, {"header": at, "point": xyz(seen.target)})
        on, _, state = seen.state.partition(": ")
        for node, (error_channel, state_channel, enabled) in nodes.items():
            if on != was_on:
                bag.write(enabled, stamp, {"data": on == node})
            if on != node:
                continue
            if seen.error is not None:
                bag.write(error_channel, stamp, {"data": seen.error})
            if states.get(node) != state:
                states[node] = state
                bag.write(state_channel, stamp, {"data": state})
        was_on = on
    bag.finish()
    return stream.getvalue()
