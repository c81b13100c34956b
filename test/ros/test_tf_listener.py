"""Feeding a buffer from topics, in the program's own thread or in another; sending transforms."""

import threading
from contextlib import ExitStack

import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time
from robot_under_test import wait_for
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from topics import FakeTFMessage, Topics
from transform_messages import shifted

from head_tracking.share import robot_file
from head_tracking.tf import (
    Buffer,
    LookupException,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
    broadcasting_possible,
)
from head_tracking.tf import broadcaster as broadcaster_module
from head_tracking.tf import listener as listener_module
from head_tracking.tf.qos import LATCHED
from head_tracking.transforms import load_robot_model

PATIENCE = Duration(seconds=20)


@pytest.fixture(scope="module")
def urdf() -> str:
    return load_robot_model(robot_file("kinectbot")).urdf


@pytest.fixture
def make_node():
    with ExitStack() as resources:
        rclpy.init()
        resources.callback(rclpy.shutdown)

        def make(name: str, *, spin: bool = False):
            node = rclpy.create_node(name)
            resources.callback(node.destroy_node)
            if spin:
                executor = SingleThreadedExecutor()
                executor.add_node(node)
                thread = threading.Thread(target=executor.spin)
                thread.start()
                resources.callback(thread.join)
                resources.callback(executor.shutdown)
            return node

        yield make


class Head:
    """Publishes a robot and its joints."""

    def __init__(self, node, urdf: str) -> None:
        self._descriptions = node.create_publisher(String, "robot_description", LATCHED)
        self._joints = node.create_publisher(JointState, "joint_states", 10)
        self._descriptions.publish(String(data=urdf))

    def describe(self, urdf: str) -> None:
        self._descriptions.publish(String(data=urdf))

    def move(self, pan: float, seconds: int) -> None:
        wait_for(lambda: self._joints.get_subscription_count() > 0)
        message = JointState(name=["head_pan_joint", "head_tilt_joint"], position=[pan, 0.0])
        message.header.stamp.sec = seconds
        self._joints.publish(message)


@pytest.fixture
def head(make_node, urdf) -> Head:
    return Head(make_node("head", spin=True), urdf)


def turned(found: TransformStamped) -> bool:
    return abs(found.transform.rotation.z) > 0.1


def test_a_listener_in_a_node_that_spins(make_node, head):
    buffer, node = Buffer(), make_node("listens", spin=True)
    listener = TransformListener(buffer, node)
    head.move(0.0, 1)
    head.move(0.5, 2)
    found = buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE)
    assert turned(found)
    found = buffer.lookup_transform("base_link", "camera_link", Time(seconds=1))
    assert not turned(found)
    listener.unregister()


def test_a_listener_in_a_thread_of_its_own(make_node, head):
    """The node does not spin: as in a callback that waits, in a single-threaded executor."""
    buffer = Buffer()
    listener = TransformListener(buffer, make_node("busy"), spin_thread=True)
    head.move(0.5, 2)
    assert turned(buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE))
    listener.unregister()


def test_the_thread_spins_the_node_with_all_of_its_callbacks(make_node, head):
    """As tf2's: the program's own timer and subscriptions run, and nobody else spins them."""
    buffer, node, ticks = Buffer(), make_node("mine"), []
    node.create_timer(0.01, lambda: ticks.append(1))
    listener = TransformListener(buffer, node, spin_thread=True)
    assert listener.node is node
    wait_for(lambda: len(ticks) > 3)
    listener.unregister()


def test_a_callback_that_fails_does_not_end_the_thread(make_node, head):
    buffer, node = Buffer(), make_node("fails")

    def fail() -> None:
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

    def on_timer() -> None:
        head.move(0.5, 2)
        found.append(buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE))
        timer.cancel()

    timer = node.create_timer(0.01, on_timer)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    wait_for(lambda: executor.spin_once(timeout_sec=0.1) or found, 30.0)
    executor.shutdown()
    listener.unregister()
    assert turned(found[0])


def test_a_listener_without_a_node(make_node, head):
    buffer = Buffer()
    listener = TransformListener(buffer)
    head.move(0.5, 2)
    assert turned(buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE))
    threads = threading.active_count()
    listener.unregister()
    assert threading.active_count() == threads - 1


def test_a_prefix_is_put_before_the_links(make_node, head):
    buffer = Buffer()
    listener = TransformListener(buffer, frame_prefix="left/")
    head.move(0.5, 2)
    found = buffer.lookup_transform("left/base_link", "left/camera_link", Time(seconds=2), PATIENCE)
    assert turned(found)
    assert not buffer.can_transform("base_link", "camera_link", Time())
    listener.unregister()


def test_who_unregistered_hears_no_more(make_node, head):
    buffer, node = Buffer(), make_node("leaves", spin=True)
    listener = TransformListener(buffer, node)
    wait_for(lambda: node.count_subscribers("joint_states") == 1)
    listener.unregister()
    wait_for(lambda: node.count_subscribers("joint_states") == 0)


def test_bad_messages_change_nothing(make_node, head, urdf):
    buffer = Buffer()
    listener = TransformListener(buffer)
    head.move(0.5, 2)
    buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE)
    head.describe("<robot")
    head.move(float("nan"), 3)
    head.move(0.4, 4)
    assert turned(buffer.lookup_transform("base_link", "camera_link", Time(seconds=4), PATIENCE))
    assert buffer.core.latest_joint_position("head_pan_joint") == (4_000_000_000, 0.4)
    listener.unregister()


def test_the_robot_can_be_exchanged(make_node, head, urdf):
    buffer = Buffer()
    listener = TransformListener(buffer)
    head.move(0.5, 2)
    buffer.lookup_transform("base_link", "camera_link", Time(seconds=2), PATIENCE)
    head.describe(urdf.replace("camera_link", "eye_link"))
    found = buffer.lookup_transform("base_link", "eye_link", Time(seconds=2), PATIENCE)
    assert turned(found)
    with pytest.raises(LookupException, match="camera_link"):
        buffer.lookup_transform("base_link", "camera_link", Time())
    listener.unregister()


# /tf, with a stand-in for tf2_msgs where that is missing


@pytest.fixture
def topics(monkeypatch) -> Topics:
    for module in (listener_module, broadcaster_module):
        monkeypatch.setattr(module, "TFMessage", FakeTFMessage)
    return Topics()


def test_tf_and_tf_static_are_heard(topics):
    buffer = Buffer()
    listener = TransformListener(buffer, topics)
    topics.callbacks["/tf"](FakeTFMessage(transforms=[shifted(1.0, 1), shifted(3.0, 3)]))
    topics.callbacks["/tf_static"](FakeTFMessage(transforms=[shifted(5.0, 0, "world", "map")]))
    found = buffer.lookup_transform("world", "ball", Time(seconds=2))
    assert found.transform.translation.x == pytest.approx(7.0)
    topics.callbacks["/tf"](FakeTFMessage(transforms=[shifted(float("nan"), 4), shifted(4.0, 4)]))
    assert buffer.lookup_transform("map", "ball", Time()).transform.translation.x == 4.0
    listener.unregister()
    assert not topics.callbacks


def test_other_topics_and_static_only(topics):
    TransformListener(Buffer(), topics, tf_topic="/old/tf", tf_static_topic="/old/tf_static")
    assert {"/old/tf", "/old/tf_static", "joint_states"} <= set(topics.callbacks)
    only = Topics()
    TransformListener(Buffer(), only, static_only=True)
    assert set(only.callbacks) == {"/tf_static"}


def test_broadcasters_send_one_or_several(topics):
    moving = TransformBroadcaster(topics)
    moving.sendTransform(shifted(1.0, 1))
    moving.sendTransform([shifted(2.0, 2), shifted(3.0, 3)])
    sent = topics.publishers["/tf"].sent
    assert [[t.header.stamp.sec for t in message.transforms] for message in sent] == [[1], [2, 3]]


def test_a_late_listener_gets_all_static_transforms(topics):
    static = StaticTransformBroadcaster(topics)
    static.sendTransform(shifted(1.0, 1, child="a"))
    static.sendTransform([shifted(2.0, 2, child="b"), shifted(9.0, 3, child="a")])
    last = topics.publishers["/tf_static"].sent[-1]
    found = {t.child_frame_id: t.transform.translation.x for t in last.transforms}
    assert found == {"a": 9.0, "b": 2.0}


@pytest.mark.skipif(broadcasting_possible(), reason="tf2_msgs is installed")
@pytest.mark.parametrize("kind", [TransformBroadcaster, StaticTransformBroadcaster])
def test_without_tf2_msgs_broadcasting_says_what_to_install(kind):
    with pytest.raises(ImportError, match="ros-jazzy-tf2-msgs"):
        kind(Topics())
