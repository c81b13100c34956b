"""Everything that a robot says, in a file."""

import math
import shutil
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rig import own_domain
from sensor_msgs.msg import CompressedImage, Image, JointState, PointCloud2
from std_msgs.msg import Header, String
from waiting import wait_for

from head_tracking.exceptions import HeadTrackingError
from head_tracking.recording.recorder import Recorder, RecorderParameters
from head_tracking.recording.recording import RecordingError
from head_tracking.recording.recording_file import read_recording
from head_tracking.ros.kit.images import image_message
from head_tracking.ros.kit.spinning import NodeDied, NodeThreads
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.ros.kit.topics import LATCHED, MEASUREMENT
from head_tracking.ros.robot.recorder import RecorderNode

PAN = "head_pan_joint"


@pytest.fixture
def node(monkeypatch):
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", domain)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = Node("robot", namespace="left")
        yield node
        node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def recorder(node, tmp_path):
    recorder = Recorder(node, RecorderParameters(record_directory=str(tmp_path), record_limit=1))
    yield recorder
    recorder.stop()


@pytest.fixture
def states(node, kinectbot):
    """The joint states of a robot that is described."""
    description = node.create_publisher(String, "robot_description", LATCHED)
    description.publish(String(data=kinectbot.urdf))
    return node.create_publisher(JointState, "joint_states", 10)


def messages(file: Path) -> list[tuple[str, Any, Any]]:
    """Topic, message and record of all that is in a file, decoded by the format's own library."""
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, decoded, message)
            for _, channel, message, decoded in reader.iter_decoded_messages()
        ]


def start(recorder: Recorder, node: Node, topics: int) -> Path:
    recorder.start()
    file = recorder.file
    assert file is not None
    session = recorder._session
    wait_for(lambda: len(session._topics) + len(session._left_out) >= topics)
    ours = ("/left/joint_states", "/left/text", "/diagnostics", "/left/picture")
    wait_for(
        lambda: all(node.count_subscribers(name) for name in ours if node.count_publishers(name))
    )
    return file


def test_all_that_is_said_is_in_the_file_as_it_was_said_and_as_ros2_bag_wants_it(node, recorder):
    states = node.create_publisher(JointState, "joint_states", 10)
    latched = node.create_publisher(String, "text", LATCHED)
    latched.publish(String(data="said before"))
    health = node.create_publisher(DiagnosticArray, "/diagnostics", MEASUREMENT)
    node.create_publisher(PointCloud2, "points", 10)
    elsewhere = node.create_publisher(String, "/other/text", LATCHED)
    elsewhere.publish(String(data="of another robot"))
    file = start(recorder, node, 4)
    sent = []
    for number in range(20):
        state = JointState(name=[PAN], position=[0.01 * number], velocity=[math.nan])
        state.header.stamp.sec = number
        status = DiagnosticStatus(level=b"\x02", name="bus", message="hot")
        status.values = [KeyValue(key="a", value=str(number))]
        states.publish(state)
        health.publish(DiagnosticArray(status=[status]))
        sent.append(state)
    wait_for(lambda: recorder._session._count >= 41)
    recorder.stop()
    found = messages(file)
    assert "/left/points (" in recorder.status
    recorded = [(decoded, record) for topic, decoded, record in found if "joint_states" in topic]
    assert [decoded.position[0] for decoded, _ in recorded] == [one.position[0] for one in sent]
    said = [deserialize_message(record.data, JointState) for _, record in recorded]
    assert [str(one) for one in said] == [str(one) for one in sent]  # they have NaNs
    assert [d.data for topic, d, _ in found if topic == "/left/text"] == ["said before"]
    levels = [d.status[0].values[0].value for topic, d, _ in found if topic == "/diagnostics"]
    assert levels == [str(number) for number in range(20)]
    assert not [topic for topic, _, _ in found if topic.startswith("/other")]
    stamps = [record.log_time for _, _, record in found]
    assert stamps == sorted(stamps)
    assert abs(stamps[-1] * 1e-9 - time.time()) < 60.0
    with file.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    channel = next(one for one in summary.channels.values() if one.topic == "/left/text")
    schema = summary.schemas[channel.schema_id]
    assert (channel.message_encoding, schema.name) == ("cdr", "std_msgs/msg/String")
    assert schema.encoding == "ros2msg"
    (offer,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert offer["durability"] == "transient_local"
    assert offer["reliability"] == "reliable"
    assert offer["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
    assert summary.statistics.message_count == len(found)


def test_a_recording_ends_at_its_limit_and_can_be_read(node, recorder, states):
    noise = node.create_publisher(String, "text", 10)
    file = start(recorder, node, 3)
    generator = np.random.default_rng(1)
    states.publish(JointState(name=[PAN], position=[0.4]))

    def full():
        noise.publish(String(data=generator.bytes(20_000).hex()))
        return recorder.file is None

    wait_for(full)
    assert "1 MB (record_limit)" in recorder.status
    assert 1_000_000 <= file.stat().st_size < 10_000_000
    with file.open("rb") as stream:
        assert read_recording(stream).seen[-1].joints[PAN] == 0.4
    recorder.start()  # the next one


def test_no_file_is_begun_on_a_disk_that_is_full(recorder, tmp_path, monkeypatch):
    monkeypatch.setattr("head_tracking.recording.recorder._KEPT_FREE", math.inf)
    with pytest.raises(HeadTrackingError, match="are free on the disk"):
        recorder.start()
    assert not [*tmp_path.iterdir()]


def test_the_program_ends_with_its_file(node, tmp_path, monkeypatch):
    folder = Parameter("record_directory", value=str(tmp_path))
    with closing(NodeThreads()) as threads, StopSignal() as stop:
        threads.start(RecorderNode(parameter_overrides=[folder]))
        monkeypatch.setattr("head_tracking.recording.recorder._KEPT_FREE", math.inf)
        with pytest.raises(NodeDied, match="are free on the disk"):
            threads.wait(stop, 20.0)


def test_what_a_crash_leaves_can_be_read(node, recorder, states, tmp_path):
    file = start(recorder, node, 2)
    generator = np.random.default_rng(1)

    def left():
        noise = list(generator.normal(size=1000))
        states.publish(JointState(name=["wheel"] * 1000, position=noise))
        states.publish(JointState(name=[PAN], position=[0.3]))
        with shutil.copy(file, tmp_path / "left").open("rb") as stream:
            try:
                return read_recording(stream)
            except RecordingError:  # its first chunk is not whole yet
                return None

    recording = wait_for(left)
    assert recording.seen[-1].joints[PAN] == 0.3
    assert "cut off" in recording.notice


def test_pictures_are_compressed_and_depths_left_out(node, recorder):
    cv2 = pytest.importorskip("cv2")
    orange = np.tile(np.array([250, 120, 10], np.uint8), (60, 80, 1))
    camera = node.create_publisher(Image, "picture", MEASUREMENT)
    depth = node.create_publisher(Image, "depth", MEASUREMENT)
    file = start(recorder, node, 2)

    def left_out():
        camera.publish(Image(encoding="rgb8"))  # such as the first one of a camera
        return "/left/picture" in recorder._session._left_out

    wait_for(left_out)

    def taken():
        camera.publish(image_message(Header(frame_id="camera"), "rgb8", orange))
        depth.publish(image_message(Header(), "32FC1", np.ones((4, 4), np.float32)))
        return recorder._session._count > 0 and "/left/depth" in recorder._session._left_out

    wait_for(taken)
    recorder.stop()
    assert "/left/picture" not in recorder.status
    found = [(t, d) for t, d, _ in messages(file) if not t.startswith("/tf")]
    topic, picture = found[0]
    assert {name for name, _ in found} == {"/left/picture/compressed"}
    assert (topic, picture.header.frame_id) == ("/left/picture/compressed", "camera")
    decoded = cv2.imdecode(np.frombuffer(bytes(picture.data), np.uint8), cv2.IMREAD_COLOR)
    assert decoded[30, 40] == pytest.approx([10, 120, 250], abs=6)


def test_a_cameras_own_compressed_images_are_ten_a_second_without_its_depths(node, recorder):
    camera = node.create_publisher(CompressedImage, "picture/compressed", MEASUREMENT)
    depth = node.create_publisher(CompressedImage, "depth/compressedDepth", MEASUREMENT)
    file = start(recorder, node, 2)
    wait_for(camera.get_subscription_count)
    begun, sent = time.monotonic(), 0
    while time.monotonic() < begun + 0.5:
        camera.publish(CompressedImage(data=[sent % 256]))
        depth.publish(CompressedImage())
        sent += 1
        time.sleep(0.01)
    recorder.stop()
    found = [topic for topic, _, _ in messages(file) if topic.startswith("/left/")]
    assert set(found) == {"/left/picture/compressed"}
    assert 1 < len(found) <= 11 * (time.monotonic() - begun) + 2 < sent


def test_a_topic_with_a_name_that_ros_does_not_allow_costs_only_itself(
    node, recorder, states, monkeypatch
):
    known = Node.get_topic_names_and_types
    foreign = [("/left/a-b", ["std_msgs/msg/String"])]
    monkeypatch.setattr(Node, "get_topic_names_and_types", lambda self: foreign + known(self))
    file = start(recorder, node, 3)
    states.publish(JointState(name=[PAN], position=[0.4]))
    wait_for(lambda: recorder._session._count >= 1)
    recorder.stop()
    assert "/left/a-b (" in recorder.status
    assert [topic for topic, _, _ in messages(file) if topic.endswith("joint_states")]


def test_what_cannot_be_recorded_says_why(node, recorder, tmp_path):
    recorder.start()
    with pytest.raises(HeadTrackingError):
        recorder.start()
    recorder.stop()
    (tmp_path / "file").write_text("")
    parameters = RecorderParameters(record_directory=str(tmp_path / "file"))
    with pytest.raises(HeadTrackingError, match="record_directory"):
        Recorder(node, parameters).start()
