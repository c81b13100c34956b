"""robot_state_publisher and joint_state_publisher, in simulated time."""

import math
import random
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from random_head import RESIDUALS, kinectbot_geometry
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from head_tracking.calibration import Calibration
from head_tracking.calibration.geometry import Estimate
from head_tracking.control import ControlLoop
from head_tracking.ros.kit.diagnostics import Level, health_from_message
from head_tracking.ros.robot.joint_state_publisher import JointStatePublisherNode
from head_tracking.ros.robot.robot_state_publisher import (
    RobotStatePublisherNode,
    RobotStatePublisherParameters,
)
from head_tracking.run.options import parse_arguments
from head_tracking.tf import Buffer
from head_tracking.transforms import JointState as Sample
from head_tracking.transforms import RobotModelError, TransformBuffer, parse_robot_model

ARM = """
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <axis xyz="0 0 1"/><limit lower="0.5" upper="1.5" effort="1" velocity="1"/></joint>
  <joint name="flange" type="fixed"><parent link="lower"/><child link="tip"/></joint>
</robot>"""
FOLLOWING = ARM.replace(
    '<child link="lower"/>',
    '<child link="lower"/><mimic joint="shoulder" multiplier="2.0" offset="0.2"/>',
)


def joints(seconds: float, **positions: float) -> JointState:
    message = JointState(name=list(positions), position=list(positions.values()))
    message.header.stamp.sec = int(seconds)
    message.header.stamp.nanosec = round(seconds % 1 * 1e9)
    return message


# robot_state_publisher


@pytest.fixture
def publish_robot(world):
    """Start a robot_state_publisher of ARM, with its buffer."""

    def start(**values):
        values = {"robot_description": ARM, "world_frame": ""} | values
        buffer = Buffer()
        node = world.make(RobotStatePublisherNode, values, buffer=buffer)
        world.run(0.01)
        return node, buffer.core

    return start


@pytest.fixture
def tf(world):
    """The transforms on /tf and /tf_static, message by message."""
    pytest.importorskip("tf2_msgs.msg")
    heard = {topic: world.record(f"/{topic}") for topic in ("tf", "tf_static")}
    return lambda topic: [message.transforms for _, message in heard[topic]]


def test_the_model_can_be_exchanged_while_running(world, publish_robot, tf):
    described = world.record("/robot_description")
    node, frames = publish_robot()
    assert [t.child_frame_id for t in tf("tf_static")[-1]] == ["tip"]
    other = ARM.replace("tip", "hand")
    (result,) = node.set_parameters([Parameter("robot_description", value=other)])
    assert result.successful
    world.run(0.01)
    assert [message.data for _, message in described] == [ARM, other]
    assert "hand" in frames.frames()
    assert "tip" not in frames.frames()
    assert [t.child_frame_id for t in tf("tf_static")[-1]] == ["hand"]


@pytest.mark.parametrize("bad", ["<robot", ARM.replace('parent link="base"', 'parent link="no"')])
def test_a_model_that_cannot_be_used_is_refused_and_the_old_one_stays(publish_robot, bad):
    node, frames = publish_robot()
    (result,) = node.set_parameters([Parameter("robot_description", value=bad)])
    assert not result.successful
    assert result.reason
    assert frames.can_transform("lower", "tip")
    with pytest.raises(RobotModelError):
        publish_robot(robot_description=bad)


def test_moving_frames_go_to_tf_if_their_joint_was_measured(world, publish_robot, tf):
    publish_robot()
    world.publish("/joint_states", joints(1.0, elbow=1.0))
    world.publish("/joint_states", joints(1.5, shoulder=0.5, elbow=1.0))
    world.run(0.01)
    (first,), (upper, lower) = tf("tf")
    assert first.child_frame_id == "lower"
    assert (upper.header.frame_id, upper.child_frame_id) == ("base", "upper")
    assert (upper.header.stamp.sec, upper.header.stamp.nanosec) == (1, 500_000_000)
    assert upper.transform.rotation.z == pytest.approx(math.sin(0.25))
    assert lower.transform.rotation.z == pytest.approx(math.sin(0.5))


@pytest.mark.parametrize(
    ("ignore_timestamp", "sent", "stamps"),
    [
        (False, (5, 4.5, 6), [5, 6]),
        (True, (5, 4.5, 6), [5, 5, 6]),  # the newest that is known
        (True, (0, 0, 0), [0, 0, 0]),
    ],
)
def test_stamps_that_stay_or_go_back(world, publish_robot, tf, ignore_timestamp, sent, stamps):
    publish_robot(ignore_timestamp=ignore_timestamp)
    for second in sent:
        world.publish("/joint_states", joints(second, shoulder=0.5, elbow=1.0))
        world.run(0.01)
    assert [moving[0].header.stamp.sec for moving in tf("tf")] == stamps


@pytest.mark.parametrize(("rate", "share"), [(20, 1.0), (21, 20 / 21), (100, 0.2)])
def test_a_stream_that_is_too_fast_is_thinned_and_another_passes_whole(
    world, publish_robot, tf, rate, share
):
    publish_robot(publish_frequency=20.0)
    rnd, count = random.Random(1), 200
    for index in range(count):
        stamp = 100.0 + index / rate + (rnd.uniform(-0.02, 0.02) if rate == 20 else 0.0)
        world.publish("/joint_states", joints(stamp, shoulder=0.5, elbow=1.0))
        world.run(0.002)
    assert len(tf("tf")) == pytest.approx(share * count, abs=0 if rate == 20 else 2)


def test_after_a_clock_that_jumped_back_tf_goes_on(world, publish_robot, tf):
    publish_robot()
    now = world.now // 10**9
    world.publish("/joint_states", joints(now + 3600, shoulder=0.5, elbow=1.0))
    world.run(0.01)
    world.publish("/joint_states", joints(now, shoulder=0.7, elbow=1.0))
    world.run(0.01)
    assert [moving[0].header.stamp.sec for moving in tf("tf")] == [now + 3600, now]
    assert tf("tf")[-1][0].transform.rotation.z == pytest.approx(math.sin(0.35))


@pytest.fixture
def calibration(tmp_path):
    """A calibration that is 400 days old, in a file."""
    changes = np.array([0.03, 0.05, -0.02, 0.004, 0.003, 0.006, 0.01, 0.0, 0.0, 0.0])
    pitch = {"camera pitch": Estimate(0.02, 0.001, True)}
    found = Calibration.of(kinectbot_geometry(), changes, pitch, 0.3, 20, 1, RESIDUALS)
    path = tmp_path / "calibration.yaml"
    replace(found, made=time.time() - 400 * 86_400).save(path)
    return Calibration.load(path)


def test_a_run_publishes_the_calibrated_model(calibration):
    run = parse_arguments(["--sim", "--calibration", str(calibration.source)])
    (publisher,) = [node for node in run.nodes if node.name == "robot_state_publisher"]
    model = RobotStatePublisherParameters(**publisher.parameters).model()
    expected = calibration.apply(kinectbot_geometry().model)
    frames = ("neck_link", "camera_optical_frame", {})
    assert np.allclose(
        model.transform(*frames).as_matrix(), expected.transform(*frames).as_matrix()
    )


def test_diagnostics_tell_its_values_deviations_age_and_source(world, calibration):
    said = world.record("/diagnostics")
    world.make(RobotStatePublisherNode, {"calibration": str(calibration.source)}, buffer=Buffer())
    world.run(1.1)
    health = health_from_message(said[0][1].status[0])
    assert health.name == "robot_state_publisher: calibration"
    assert health.level is Level.WARN
    assert "400" in health.message
    assert health.values["source"] == str(calibration.source)
    assert re.match(r"\+1\.15 degrees ± 0\.06", health.values["camera pitch"])


# joint_state_publisher


@pytest.fixture
def complete(world):
    """Run a joint_state_publisher of ARM; return what it publishes for measurements."""

    def run(*measured, urdf=ARM, **values):
        values = {"source_list": ["hands"]} | values
        world.make(JointStatePublisherNode, values)
        world.publish("/robot_description", String(data=urdf))
        world.run(0.002)
        found = world.record("/joint_states")
        for message in measured:
            world.publish("/hands", message)
        world.run(0.15)
        return [message for _, message in found]

    return run


def positions(message: JointState) -> dict[str, float]:
    return dict(zip(message.name, message.position, strict=True))


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"publish_default_positions": True}, {"shoulder": 0.0, "elbow": 1.0}),
        ({"zeros.elbow": 0.7, "zeros.shoulder": 1}, {"shoulder": 1.0, "elbow": 0.7}),
    ],
)
def test_defaults_are_sent_on_request(complete, values, expected):
    found = complete(**values)
    assert positions(found[0]) == expected
    assert found[0].header.stamp.sec > 0


def test_a_joint_that_depends_on_another_follows_it(complete):
    rule = {
        "dependent_joints.elbow.parent": "shoulder",
        "dependent_joints.elbow.factor": 0.5,
        "dependent_joints.elbow.offset": 1.0,
    }
    message = joints(3.0, shoulder=0.4)
    message.velocity = [0.2]
    (found,) = complete(message, **rule)
    assert positions(found) == {"shoulder": 0.4, "elbow": pytest.approx(1.2)}
    assert list(found.velocity) == [0.2, pytest.approx(0.1)]


@pytest.mark.parametrize(
    "bad",
    [
        {"zeros.nose": 1.0},
        {"zeros.elbow": 1.0, "dependent_joints.elbow.parent": "shoulder"},
        {"dependent_joints.elbow.parent": "nose"},
    ],
)
def test_a_rule_for_a_joint_that_is_not_there_is_reported(complete, bad, capfd):
    complete(joints(3.0, shoulder=0.4), **bad)
    assert "robot_description" in capfd.readouterr().err


def test_in_the_loop_the_model_is_that_of_the_buffer_and_others_measure_other_joints(world):
    buffer = TransformBuffer()
    buffer.set_model(parse_robot_model(FOLLOWING))
    loop = ControlLoop(buffer)
    world.make(JointStatePublisherNode, {}, loop=loop)
    read = loop.joints_read(1, {"shoulder": Sample(0.5)})
    assert {name: joint.position for name, joint in read.items()} == {"shoulder": 0.5, "elbow": 1.2}
    buffer.set_joint_positions(2, {"shoulder": 1.5, "wheel": 1.0})  # from joint_states
    assert buffer.latest_joint_position("shoulder") == (1, 0.5)
    assert buffer.latest_joint_position("wheel") == (2, 1.0)
    buffer.set_model(parse_robot_model(FOLLOWING.replace('"upper"', '"arm"')))
    assert loop.joints_read(2, {"shoulder": Sample(0.6)})["elbow"].position == 1.4
    assert buffer.lookup_transform("base", "arm").stamp == 2


def test_a_flood_of_invalid_messages_is_logged_once_a_second_in_short_lines(world, capfd):
    world.make(JointStatePublisherNode, {"robot_description": ARM})
    world.make(RobotStatePublisherNode, {"robot_description": ARM}, buffer=Buffer())
    capfd.readouterr()
    for _ in range(50):
        world.publish("/robot_description", String(data="<robot"))
        for topic in ("/servo_states", "/joint_states"):
            world.publish(topic, joints(1.0, **{"x" * 9999: math.nan}))
        world.run(0.002)
    lines = [line for line in capfd.readouterr().err.splitlines() if "ERROR" in line]
    assert 2 <= len(lines) < 50
    assert max(map(len, lines)) < 1000
