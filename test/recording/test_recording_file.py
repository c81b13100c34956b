"""Recordings as files: of other programs, and broken ones."""

import io
import math
import tracemalloc
from collections.abc import Sequence
from operator import itemgetter
from typing import Any

import mcap_ros2.writer
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType

from head_tracking.recording import recording_file
from head_tracking.recording.recording import Recording, RecordingError
from head_tracking.recording.recording_file import read_recording
from head_tracking.ros.kit.message_types import message_definition
from head_tracking.transforms import RobotModel

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
PAN = "head_pan_joint"
TYPES = {
    "robot_description": "std_msgs/msg/String",
    "joint_states": "sensor_msgs/msg/JointState",
    "/tf": "tf2_msgs/msg/TFMessage",
    "target_point": "geometry_msgs/msg/PointStamped",
    "head_tracker/enabled": "std_msgs/msg/Bool",
    "head_tracker/status": "diagnostic_msgs/msg/DiagnosticStatus",
    "point_head/status": "diagnostic_msgs/msg/DiagnosticStatus",
    "stopped": "std_msgs/msg/Bool",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/rosout": "rcl_interfaces/msg/Log",
    "camera/image/compressed": "sensor_msgs/msg/CompressedImage",
    "visual_target/image/compressed": "sensor_msgs/msg/CompressedImage",
    "depth/compressedDepth": "sensor_msgs/msg/CompressedImage",
}


def at(seconds: float) -> int:
    return START + round(seconds * SECOND)


def header(stamp: int, frame_id: str) -> dict[str, Any]:
    seconds, nanoseconds = divmod(stamp, SECOND)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


def xyz(numbers: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, numbers), strict=True))


def transform_of(stamp: int, parent: str, child: str, place: Sequence[float]) -> dict[str, Any]:
    transform = {"translation": xyz(place), "rotation": {"w": 1.0}}
    return {"header": header(stamp, parent), "child_frame_id": child, "transform": transform}


def read(data: bytes) -> Recording:
    return read_recording(io.BytesIO(data))


def bag(
    messages: list[tuple[float, str, Any]],  # time [s], topic and fields of each, in any order
    base: str = "/",  # of the topics
    # a topic of another program, and its schema; None: it is JSON without one
    foreign: tuple[str, str | None] | None = None,
    **options: Any,  # of the library
) -> bytes:
    """A file by the format's own library, as other programs write it."""
    stream = io.BytesIO()
    with mcap_ros2.writer.Writer(stream, **options) as writer:
        if foreign is not None:
            topic, schema = foreign
            kind = TYPES.get(topic, TYPES.get(topic.rpartition("/")[2], ""))
            number = schema and writer._writer.register_schema(kind, "ros2msg", schema.encode())
            encoding = "json" if schema is None else "cdr"
            channel = writer._writer.register_channel(topic, encoding, number or 0)
            writer._writer.add_message(channel, at(0.0), b"{}", at(0.0))
        schemas = {}
        for seconds, topic, message in sorted(messages, key=itemgetter(0)):
            if topic not in schemas:
                kind = TYPES[topic]
                schemas[topic] = writer.register_msgdef(kind, message_definition(kind))
            name = topic if topic.startswith("/") else base + topic
            writer.write_message(name, schemas[topic], message, at(seconds))
    return stream.getvalue()


def joints(seconds: float, pan: float, **fields: Any) -> tuple[float, str, Any]:
    message = {"header": header(at(seconds), ""), "name": [PAN], "position": [pan]}
    return seconds, "joint_states", message | fields


def moving(model: RobotModel, length: float) -> list[tuple[float, str, Any]]:
    return [
        (0.0, "robot_description", {"data": model.urdf}),
        *(joints(0.02 * n, math.sin(0.02 * n)) for n in range(round(50 * length))),
    ]


@pytest.mark.parametrize("compression", CompressionType)
def test_a_bag_of_stock_nodes_opens(kinectbot, compression):
    gripper = (0.5, 0.0, 1.0)
    link = transform_of(at(0.0), "base_link", kinectbot.joints[PAN].child, gripper)
    hand = transform_of(at(0.1), "base_link", "gripper", gripper)
    messages = [
        *moving(kinectbot, 5.0),
        (0.1, "/tf", {"transforms": [hand, link]}),
        (1.0, "target_point", {"header": header(0, "gripper"), "point": xyz((1.0, 0.0, 0.0))}),
    ]
    recording = read(bag(messages, "/left/", compression=compression))
    assert recording.duration == pytest.approx(5.0, abs=0.1)
    assert len(recording.seen) == pytest.approx(5.0 / 0.04, abs=2)
    assert recording.at(2.0).joints[PAN] == pytest.approx(math.sin(2.0), abs=0.05)
    x, y, _ = recording.at(1.5).target
    assert (x, y) == pytest.approx((1.5, 0.0))
    assert recording.at(4.5).target is None  # nobody sent it any more


@pytest.mark.parametrize("has_target", [True, False])
def test_a_target_is_shown_while_the_controller_has_it(kinectbot, has_target):
    field = {"key": "target", "value": "true" if has_target else "false"}
    messages = [
        *moving(kinectbot, 5.0),
        (0.5, "head_tracker/status", {"name": "head_tracker", "values": [field]}),
        (1.0, "target_point", {"header": header(0, "base_link"), "point": xyz((1.0, 0.0, 0.0))}),
    ]
    recording = read(bag(messages))
    for time in (1.5, 4.5):
        assert (recording.at(time).target is not None) is has_target


def test_what_happened_is_found_on_the_time_line(kinectbot):
    hot = {"name": "servo_bus: pan", "level": 2, "message": "too hot", "values": []}
    messages = [
        *moving(kinectbot, 8.0),
        (0.1, "stopped", {"data": False}),
        (0.1, "head_tracker/enabled", {"data": True}),
        (3.0, "stopped", {"data": True}),
        (3.1, "head_tracker/enabled", {"data": False}),
        (4.0, "/diagnostics", {"header": header(at(4.0), ""), "status": [hot]}),
        (5.0, "/diagnostics", {"header": header(at(5.0), ""), "status": [hot]}),
        (6.0, "/rosout", {"level": 40, "name": "servo_bus", "msg": "the port has gone"}),
        (7.0, "stopped", {"data": False}),
    ]
    recording = read(bag(messages))
    assert [(round(one.time, 1), one.text) for one in recording.moments] == [
        (3.0, "STOP"),
        (3.1, "head_tracker off"),
        (4.0, "servo_bus: pan: too hot"),
        (6.0, "servo_bus: the port has gone"),
        (7.0, "resume"),
    ]
    assert recording.at(5.0).text == "stopped"


def pictures(topic: str, length: float, size: int = 4) -> list[tuple[float, str, Any]]:
    return [
        (0.1 * n, topic, {"header": header(at(0.1 * n), "camera"), "data": [n % 256] * size})
        for n in range(round(10 * length))
    ]


def test_the_cameras_pictures_are_there_with_what_was_found_first(kinectbot):
    messages = [
        *moving(kinectbot, 5.0),
        *pictures("camera/image/compressed", 5.0),
        *pictures("visual_target/image/compressed", 2.0),
        *pictures("depth/compressedDepth", 5.0),
    ]
    recording = read(bag(messages, "/left/"))
    start = recording.seen[0].stamp
    picture = recording.picture_at((at(1.55) - start) * 1e-9)
    assert picture == bytes([15] * 4)
    assert recording.picture_at(4.5) is None  # it has seen nothing for long


def test_a_file_that_was_cut_off_opens_up_to_there(kinectbot):
    data = bag(moving(kinectbot, 10.0), chunk_size=5_000)
    whole = read(data)
    assert not whole.notice
    durations = []
    for size in range(len(data) // 3, len(data) - 1, len(data) // 15):
        recording = read(data[:size])
        assert "cut off" in recording.notice
        assert recording.at(1.5) == whole.at(1.5)
        durations.append(recording.duration)
    assert durations == sorted(durations)
    assert durations[-1] > 7.0
    with pytest.raises(RecordingError, match="cut off"):
        read(data[:100])


def test_a_day_is_shown_in_fewer_pictures_and_no_more_memory(kinectbot, monkeypatch):
    monkeypatch.setattr(recording_file, "_MOST", 100)
    messages = [
        (0.0, "robot_description", {"data": kinectbot.urdf}),
        *(joints(40.0 * n, 0.001 * n) for n in range(2000)),
    ]
    recording = read(bag(messages))
    assert len(recording.seen) <= 102
    assert recording.duration == pytest.approx(79_960.0, rel=0.01)
    assert recording.at(40_000.0).joints[PAN] == pytest.approx(1.0, abs=0.03)


def test_a_chunk_that_unpacks_to_very_much_is_not_unpacked(monkeypatch):
    size = 30_000_000
    monkeypatch.setattr(recording_file, "_LARGEST", size - 1)
    data = bag([(0.0, "robot_description", {"data": " " * size})], chunk_size=2 * size)
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError):
            read(data)
        assert tracemalloc.get_traced_memory()[1] < size / 2
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("messages", "said"),
    [
        ([joints(0.0, 0.1)], "no robot_description"),
        ([(0.0, "robot_description", {"data": "<robot"}), joints(0.1, 0.1)], "invalid"),
    ],
)
def test_what_lacks_the_robot_or_its_joints_says_so(kinectbot, messages, said):
    with pytest.raises(RecordingError, match=said):
        read(bag(messages))
    with pytest.raises(RecordingError, match="no joint_states in /"):
        read(bag([(0.0, "robot_description", {"data": kinectbot.urdf})]))


@pytest.mark.parametrize(
    ("topic", "wrong"),
    [
        ("/notes", None),
        ("/other/robot_description", "%%%\n"),
        ("/diagnostics", "float64 x\n"),
        ("/tf", "A transforms\n" + "=" * 80 + "\nMSG: tf2_msgs/A\nA a\n"),
    ],
)
def test_a_channel_without_a_schema_or_with_a_wrong_one_is_left_out(kinectbot, topic, wrong):
    recording = read(bag(moving(kinectbot, 2.0), foreign=(topic, wrong)))
    assert recording.duration > 1.5
    is_read = wrong is not None and "robot_description" not in topic
    assert (topic in recording.notice) is is_read


def test_nonsense_among_the_messages_is_left_out(kinectbot):
    bad = [
        joints(0.5, math.nan),
        joints(0.6, 0.1, position=[]),
        (0.7, "target_point", {"header": header(0, "nowhere"), "point": xyz((1.0, 0.0, 0.0))}),
        (0.8, "target_point", {"header": header(0, "base_link"), "point": xyz((math.inf, 0, 0))}),
        (0.9, "/tf", {"transforms": [{"child_frame_id": "a", "header": header(0, "base_link")}]}),
    ]
    recording = read(bag([*moving(kinectbot, 2.0), *bad]))
    assert recording.at(1.5).joints[PAN] == pytest.approx(math.sin(1.5), abs=0.05)
    assert recording.at(1.5).target is None


@given(st.binary(max_size=400), st.sampled_from([b"", b"\x89MCAP0\r\n"]))
def test_any_other_file_is_refused_with_a_reason(data, start):
    with pytest.raises(RecordingError):
        read(start + data)


@given(st.data())
def test_a_file_with_a_wrong_byte_is_shown_or_refused_and_nothing_else(kinectbot, data):
    content = bytearray(CONTENT or CONTENT.extend(bag(moving(kinectbot, 1.0))) or CONTENT)
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(8, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        assert read(bytes(content)).seen
    except RecordingError as error:
        assert str(error)


CONTENT = bytearray()
