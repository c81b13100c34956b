"""Feeding a buffer from topics, in the program's own thread or in another; sending transforms."""

import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.time import Time
from rig import JOINTS
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from transform_messages import shifted
from waiting import wait_for

from head_tracking.ros.kit.topics import LATCHED
from head_tracking.tf import (
    Buffer,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
    broadcasting_possible,
    listening_buffer,
)

PATIENCE = Duration(seconds=20)


@pytest.fixture
def make_node(start):
    def make(name, *, spin=False, **options):
        node = rclpy.create_node(name, **options)
        return start(node) if spin else node

    return make


class Head:
    """Publishes a robot and its joints."""

    def __init__(self, node, urdf: str) -> None:
        self._descriptions = node.create_publisher(String, "robot_description", LATCHED)
        self._joints = node.create_publisher(JointState, "joint_states", 10)
        self._descriptions.publish(String(data=urdf))

    def move(self, pan: float, seconds: int, joints=JOINTS) -> None:
        wait_for(lambda: self._joints.get_subscription_count() > 0)
        message = JointState(name=list(joints), position=[pan, 0.0])
        message.header.stamp.sec = seconds
        self._joints.publish(message)


@pytest.fixture
def head(make_node, kinectbot):
    return Head(make_node("head", spin=True), kinectbot.urdf)


def turned(found: TransformStamped) -> bool:
    return abs(found.transform.rotation.z) > 0.1


def test_a_callback_that_fails_does_not_end_the_thread(make_node, head):
    buffer, node = Buffer(), make_node("fails")

    def fail():
        raise ValueError("of the program's own")

    node.create_timer(0.01, fail)
    listener = TransformListener(buffer, node, spin_thread=True)
    head.move(0.5, 2)
    assert turned(buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE))
    listener.unregister()


def test_a_callback_waits_for_data_while_its_executor_is_busy_with_it(make_node, head):
    """tf2's classic deadlock: the timer's callback holds the only thread of the executor."""
    buffer, node = Buffer(), make_node("waits")
    listener = TransformListener(buffer)
    found = []

    def on_timer():
        head.move(0.5, 2)
        found.append(buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE))
        timer.cancel()

    timer = node.create_timer(0.01, on_timer)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    wait_for(lambda: executor.spin_once(timeout_sec=0.1) or found)
    executor.shutdown()
    listener.unregister()
    assert turned(found[0])


def test_a_node_that_listens_has_the_prefix_as_a_parameter(make_node, head):
    """As robot_state_publisher in another process: /tf has its frames with the prefix."""
    prefix = Parameter("frame_prefix", value="left/")
    buffer = listening_buffer(make_node("prefixed", spin=True, parameter_overrides=[prefix]))
    head.move(0.5, 2)
    found = buffer.lookup_transform("left/base_link", "left/camera_link", Time(), PATIENCE)
    assert turned(found)
    assert not buffer.can_transform("base_link", "camera_link", Time())


def test_joints_of_a_second_robot_do_not_turn_the_first(make_node, head):
    """Its joints have the same names; its frames come from /tf, as in a buffer of tf2."""
    buffer = Buffer()
    first = TransformListener(buffer, make_node("first", spin=True))
    other = make_node("listens", namespace="other")
    second = TransformListener(buffer, other, frame_prefix="right/", spin_thread=True)
    assert other.count_subscribers("joint_states") == 0
    assert second.tf_sub.topic_name == "/tf"
    head.move(0.5, 2)
    found = buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE)
    assert turned(found)
    second.unregister()
    first.unregister()
    TransformListener(buffer, other, frame_prefix="right/")
    assert other.count_subscribers("joint_states") == 1


def test_a_system_clock_that_was_set_back_is_followed(make_node, head):
    """Its joint states would be too old for an hour; what it stamped before is forgotten."""
    buffer, node = Buffer(), make_node("set_back", spin=True)
    TransformListener(buffer, node)
    now = node.get_clock().now().nanoseconds // 1_000_000_000
    head.move(0.1, now + 3600)
    buffer.lookup_transform("base_link", "camera_link", Time(), PATIENCE)
    head.move(0.5, now - 5)
    found = buffer.lookup_transform("base_link", "camera_link", Time(seconds=now - 5), PATIENCE)
    assert turned(found)
    head.move(0.2, now - 90)  # late, and no jump
    head.move(0.1, now + 5, ("shoulder", "elbow"))  # of a machine whose clock is ahead
    head.move(0.6, now - 4)
    assert buffer.can_transform("base_link", "camera_link", Time(seconds=now - 4), PATIENCE)
    assert buffer.can_transform("base_link", "camera_link", Time(seconds=now - 5))


# /tf


@pytest.fixture
def tf(make_node):
    """A node that spins, with broadcasters of both kinds."""
    pytest.importorskip("tf2_msgs.msg")
    node = make_node("broadcasts", spin=True)
    return TransformBroadcaster(node), StaticTransformBroadcaster(node)


def send(broadcaster, transforms) -> None:
    wait_for(lambda: broadcaster.pub_tf.get_subscription_count() > 0)
    broadcaster.sendTransform(transforms)


def test_tf_and_tf_static_are_heard(tf):
    buffer = Buffer()
    listener = TransformListener(buffer)
    moving, static = tf
    send(static, shifted(5.0, 0, "world", "map"))
    send(moving, [shifted(1.0, 1), shifted(3.0, 3)])
    found = buffer.lookup_transform("world", "ball", Time(seconds=2), PATIENCE)
    assert found.transform.translation.x == pytest.approx(7.0)
    its_own_parent = shifted(1.0, 4, "ball", "ball")
    send(moving, [shifted(float("nan"), 4), its_own_parent, shifted(4.0, 4)])
    found = buffer.lookup_transform("map", "ball", Time(seconds=4), PATIENCE)
    assert found.transform.translation.x == 4.0
    listener.unregister()
    wait_for(lambda: moving.pub_tf.get_subscription_count() == 0)


def test_a_late_listener_gets_all_static_transforms(tf):
    _, static = tf
    static.sendTransform(shifted(1.0, 1, child="a"))
    static.sendTransform([shifted(2.0, 2, child="b"), shifted(9.0, 3, child="a")])
    buffer = Buffer()
    listener = TransformListener(buffer, static_only=True)
    found = buffer.lookup_transform("a", "b", Time(), PATIENCE)
    assert found.transform.translation.x == -7.0
    listener.unregister()


def test_other_topics(make_node, tf):
    node = make_node("renamed")
    qos = {"tf_topic": "/old/tf", "tf_static_topic": "/old/tf_static", "qos": 5, "static_qos": 5}
    listener = TransformListener(Buffer(), node, **qos)
    assert listener.tf_sub.topic_name == "/old/tf"
    assert listener.tf_static_sub.topic_name == "/old/tf_static"
    only = TransformListener(Buffer(), node, static_only=True)
    assert [s.topic_name for s in only._subscriptions] == ["/tf_static"]


def test_a_buffer_by_others_gets_tf_and_nothing_else(make_node, tf):
    """As tf2_ros's, which knows nothing of joints."""

    class Theirs:
        def __init__(self):
            self.taken = []

        def set_transform(self, transform, authority):
            self.taken.append((transform.child_frame_id, authority))

        set_transform_static = set_transform

    buffer = Theirs()
    listener = TransformListener(buffer, make_node("feeds", spin=True))
    send(tf[0], shifted(1.0, 1))
    wait_for(lambda: buffer.taken == [("ball", "default_authority")])
    assert listener.node.count_subscribers("joint_states") == 0


@pytest.mark.skipif(broadcasting_possible(), reason="tf2_msgs is installed")
@pytest.mark.parametrize("kind", [TransformBroadcaster, StaticTransformBroadcaster])
def test_without_tf2_msgs_broadcasting_says_what_to_install(kind):
    with pytest.raises(ImportError):
        kind(None)
