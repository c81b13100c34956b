"""robot_state_publisher and joint_state_publisher, each in a thread as in a composition."""

import math
import threading
from contextlib import ExitStack

import pytest
import rclpy
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from waiting import wait_for

from head_tracking.control import ControlLoop
from head_tracking.ros.kit.topics import LATCHED
from head_tracking.ros.robot.joint_state_publisher import JointStatePublisherNode
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherNode
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


class Program:
    """Nodes that run, and a person who talks to them."""

    def __init__(self, resources: ExitStack) -> None:
        self._resources = resources
        self.log: list[str] = []
        self.person = self.run(rclpy.create_node("person"))
        self.person.create_subscription(
            Log, "/rosout", lambda message: self.log.append(message.msg), 100
        )

    def run(self, node):
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        self._resources.callback(node.destroy_node)
        self._resources.callback(thread.join)
        self._resources.callback(executor.shutdown)
        return node

    def listen(self, kind, topic, qos=10):
        messages: list = []
        self.person.create_subscription(kind, topic, messages.append, qos)
        return messages

    def talk(self, kind, topic, qos=10):
        publisher = self.person.create_publisher(kind, topic, qos)
        wait_for(lambda: publisher.get_subscription_count() > 0)
        return publisher


@pytest.fixture
def program():
    with ExitStack() as resources:
        rclpy.init()
        resources.callback(rclpy.shutdown)
        yield Program(resources)


def parameters(**values) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


def joints(seconds: float, **positions: float) -> JointState:
    message = JointState(name=list(positions), position=list(positions.values()))
    message.header.stamp.sec = int(seconds)
    message.header.stamp.nanosec = round(seconds % 1 * 1e9)
    return message


# robot_state_publisher

KEPT = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def robot_state_publisher(**values) -> RobotStatePublisherNode:
    values = {"robot_description": ARM, "world_frame": ""} | values
    return RobotStatePublisherNode(Buffer(), parameter_overrides=parameters(**values))


def test_the_model_can_be_exchanged_while_running(program):
    node = program.run(robot_state_publisher())
    described = program.listen(String, "robot_description", LATCHED)
    wait_for(lambda: described)
    other = ARM.replace("tip", "hand")
    (result,) = node.set_parameters(parameters(robot_description=other))
    assert result.successful
    wait_for(lambda: described[-1].data == other)
    assert "hand" in node._buffer.core.frames()
    assert "tip" not in node._buffer.core.frames()


@pytest.mark.parametrize("bad", ["<robot", ARM.replace('parent link="base"', 'parent link="no"')])
def test_a_model_that_cannot_be_used_is_refused_and_the_old_one_stays(program, bad):
    node = program.run(robot_state_publisher())
    (result,) = node.set_parameters(parameters(robot_description=bad))
    assert not result.successful
    assert result.reason
    assert node._buffer.core.can_transform("lower", "tip")
    with pytest.raises(RobotModelError):
        robot_state_publisher(robot_description=bad)


@pytest.fixture
def tf(program):
    """The transforms heard on /tf and /tf_static, message by message."""
    kind = pytest.importorskip("tf2_msgs.msg").TFMessage
    qos = {"tf": 100, "tf_static": KEPT}
    heard = {topic: program.listen(kind, f"/{topic}", qos[topic]) for topic in qos}
    return lambda topic: [message.transforms for message in heard[topic]]


def test_moving_frames_go_to_tf_and_the_others_to_tf_static(program, tf):
    program.run(robot_state_publisher())
    wait_for(lambda: tf("tf_static"))
    assert [t.child_frame_id for t in tf("tf_static")[-1]] == ["tip"]
    program.talk(JointState, "joint_states").publish(joints(1.5, shoulder=0.5, elbow=1.0))
    wait_for(lambda: tf("tf"))
    upper, lower = tf("tf")[0]
    assert (upper.header.frame_id, upper.child_frame_id) == ("base", "upper")
    assert (upper.header.stamp.sec, upper.header.stamp.nanosec) == (1, 500_000_000)
    assert upper.transform.rotation.z == pytest.approx(math.sin(0.25))
    assert lower.transform.rotation.z == pytest.approx(math.sin(0.5))


def test_after_another_model_the_links_of_the_old_one_are_sent_no_more(program, tf):
    node = program.run(robot_state_publisher())
    wait_for(lambda: tf("tf_static"))
    node.set_parameters(parameters(robot_description=ARM.replace("tip", "hand")))
    wait_for(lambda: tf("tf_static")[-1][0].child_frame_id == "hand")
    assert [t.child_frame_id for t in tf("tf_static")[-1]] == ["hand"]
    late = program.listen(node._static_sender.pub_tf.msg_type, "/tf_static", KEPT)
    wait_for(lambda: late)
    assert [t.child_frame_id for message in late for t in message.transforms] == ["hand"]


def test_a_joint_that_nobody_measured_is_not_sent(program, tf):
    program.run(robot_state_publisher())
    program.talk(JointState, "joint_states").publish(joints(1.0, elbow=1.0))
    wait_for(lambda: tf("tf"))
    assert [t.child_frame_id for t in tf("tf")[0]] == ["lower"]


@pytest.mark.parametrize(("ignore_timestamp", "sent"), [(False, [5, 6]), (True, [5, 4.5, 6])])
def test_stamps_that_go_back(program, tf, ignore_timestamp, sent):
    node = program.run(robot_state_publisher(ignore_timestamp=ignore_timestamp))
    publisher = program.talk(JointState, "joint_states")
    for second in (5, 4.5, 6):
        publisher.publish(joints(second, shoulder=0.5, elbow=1.0))
    wait_for(lambda: node._buffer.core.latest_joint_position("elbow") == (6 * 10**9, 1.0))
    wait_for(lambda: len(tf("tf")) == len(sent))
    # the last of them is the newest that is known, whatever came in between
    assert tf("tf")[-1][0].header.stamp.sec == 6


def test_after_a_clock_that_jumped_back_tf_goes_on(program, tf):
    node = program.run(robot_state_publisher())
    publisher = program.talk(JointState, "joint_states")
    now = node.get_clock().now().nanoseconds // 10**9
    publisher.publish(joints(now + 3600, shoulder=0.5, elbow=1.0))
    wait_for(lambda: len(tf("tf")) == 1)
    publisher.publish(joints(now, shoulder=0.7, elbow=1.0))
    wait_for(lambda: len(tf("tf")) == 2)
    assert tf("tf")[-1][0].header.stamp.sec == now
    assert tf("tf")[-1][0].transform.rotation.z == pytest.approx(math.sin(0.35))


# joint_state_publisher


@pytest.fixture
def complete(program):
    """Runs a joint_state_publisher on ARM, without a source unless one is named."""

    def run(*sources: str, urdf: str = ARM, **values):
        values = {"source_list": list(sources)} | values
        program.run(JointStatePublisherNode(parameter_overrides=parameters(**values)))
        described = program.person.create_publisher(String, "robot_description", LATCHED)
        described.publish(String(data=urdf))
        return program.listen(JointState, "joint_states")

    return run


def positions(message: JointState) -> dict[str, float]:
    return dict(zip(message.name, message.position, strict=True))


def test_nothing_is_sent_that_nobody_knows(program, complete):
    found = complete("hands", rate=100.0)
    hands = program.talk(JointState, "hands")
    wait_for(lambda: hands.publish(joints(3.0, shoulder=0.5)) or found)
    assert positions(found[0]) == {"shoulder": 0.5}
    assert found[0].header.stamp.sec == 3


def test_default_positions_are_sent_on_request(complete):
    found = complete(publish_default_positions=True, rate=100.0)
    wait_for(lambda: found)
    assert positions(found[0]) == {"shoulder": 0.0, "elbow": 1.0}
    assert found[0].header.stamp.sec > 0


def test_zeros_state_where_a_joint_stands(complete):
    found = complete(rate=100.0, **{"zeros.elbow": 0.7, "zeros.shoulder": 1})
    wait_for(lambda: found)
    assert positions(found[0]) == {"shoulder": 1.0, "elbow": 0.7}


def test_a_joint_that_depends_on_another_follows_it(program, complete):
    rule = {
        "dependent_joints.elbow.parent": "shoulder",
        "dependent_joints.elbow.factor": 0.5,
        "dependent_joints.elbow.offset": 1.0,
    }
    found = complete("hands", rate=1.0, **rule)
    hands = program.talk(JointState, "hands")
    message = joints(3.0, shoulder=0.4)
    message.velocity = [0.2]
    wait_for(lambda: hands.publish(message) or found)
    assert positions(found[0]) == {"shoulder": 0.4, "elbow": pytest.approx(1.2)}
    assert list(found[0].velocity) == [0.2, pytest.approx(0.1)]


def test_velocities_may_be_missing_or_too_few(program, complete):
    found = complete("hands", rate=1.0)
    hands = program.talk(JointState, "hands")
    message = joints(3.0, shoulder=0.4, elbow=0.8)
    message.velocity = [0.2]
    wait_for(lambda: hands.publish(message) or found)
    assert positions(found[0]) == {"shoulder": 0.4, "elbow": 0.8}
    assert list(found[0].velocity) == [0.2, 0.0]
    assert not found[0].effort


def test_efforts_that_are_not_known_are_nan(program, complete):
    found = complete("hands", rate=1.0)
    hands = program.talk(JointState, "hands")
    message = joints(3.0, shoulder=0.4, elbow=0.8)
    message.effort = [1.5]
    wait_for(lambda: hands.publish(message) or found)
    assert list(found[0].effort) == pytest.approx([1.5, math.nan], nan_ok=True)


@pytest.mark.parametrize(
    "bad",
    [
        {"zeros.nose": 1.0},
        {"dependent_joints.nose.parent": "shoulder"},
        {"dependent_joints.elbow.parent": "nose"},
        {"dependent_joints.elbow.factor": 2.0},
    ],
)
def test_a_rule_for_a_joint_that_is_not_there_is_told(program, complete, bad):
    complete(**bad)
    wait_for(lambda: any("robot_description is ignored" in text for text in program.log))


def test_in_the_loop_the_model_is_that_of_the_buffer(program):
    buffer = TransformBuffer()
    buffer.set_model(parse_robot_model(ARM))
    loop = ControlLoop(buffer)
    rule = {"dependent_joints.elbow.parent": "shoulder", "dependent_joints.elbow.factor": 2.0}
    # (not spun: no message arrives)
    node = JointStatePublisherNode(loop, parameter_overrides=parameters(**rule))
    try:
        read = loop.joints_read(1, {"shoulder": Sample(0.5)})
        assert {name: joint.position for name, joint in read.items()} == {
            "shoulder": 0.5,
            "elbow": 1.0,
        }
        buffer.set_model(parse_robot_model(ARM.replace('"upper"', '"arm"')))
        assert loop.joints_read(2, {"shoulder": Sample(0.6)})["elbow"].position == 1.2
        assert buffer.lookup_transform("base", "arm").stamp == 2
    finally:
        node.destroy_node()


def test_a_zero_that_is_no_number_is_an_error(program):
    with pytest.raises(ValueError):
        JointStatePublisherNode(parameter_overrides=parameters(**{"zeros.elbow": "up"}))
