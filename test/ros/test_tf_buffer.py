"""What a program for tf2_ros and tf2_geometry_msgs may import and call: messages in and out."""

import math
import threading

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import (
    PointStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.clock import ClockType, ROSClock
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from transform_messages import shifted
from waiting import join, wait_for

from head_tracking import tf
from head_tracking.tf import (
    Buffer,
    LookupException,
    TypeException,
)

TURN = 0.5
NAMES = """
    Buffer BufferCore BufferInterface TransformListener StaticTransformListener
    TransformBroadcaster StaticTransformBroadcaster TransformRegistration
    TypeException TransformException
    LookupException ConnectivityException ExtrapolationException InvalidArgumentException
    TimeoutException DEFAULT_TF_TOPIC DEFAULT_STATIC_TF_TOPIC
    do_transform_point do_transform_vector3 do_transform_pose do_transform_pose_stamped
    do_transform_pose_with_covariance_stamped
"""
CORE = """
    set_transform set_transform_static clear can_transform_core can_transform_full_core
    lookup_transform_core lookup_transform_full_core get_latest_common_time
    all_frames_as_yaml all_frames_as_string
"""


def message(x: float, seconds: int = 1, parent: str = "map", child: str = "ball"):
    transform = shifted(x, seconds, parent, child)
    transform.transform.rotation.z = math.sin(0.5 * TURN)
    transform.transform.rotation.w = math.cos(0.5 * TURN)
    return transform


def stamped(kind: type, frame_id: str = "ball", seconds: int = 2):
    result = kind()
    result.header.frame_id = frame_id
    result.header.stamp.sec = seconds
    return result


@pytest.fixture
def buffer():
    """A ball that moves along x: at 1 m at 1 s, at 3 m at 3 s, turned by TURN about z."""
    buffer = Buffer()
    buffer.set_transform(message(1.0, 1))
    buffer.set_transform(message(3.0, 3))
    return buffer


def test_the_names_and_methods_of_tf2_are_there():
    """That an exported name exists is checked in test_architecture.py."""
    assert set(NAMES.split()) <= set(tf.__all__)
    assert set(CORE.split()) <= set(dir(tf.BufferCore))


# Lookups


def test_the_core_answers_without_waiting(buffer):
    assert buffer.lookup_transform_core("map", "ball", Time()).transform.translation.x == 3.0
    assert buffer.can_transform_core("map", "ball", Time()) == (True, "")
    possible, reason = buffer.can_transform_core("map", "ball", Time(seconds=9))
    assert not possible
    assert "future" in reason
    times = (Time(seconds=1), "ball", Time(seconds=3))
    full = buffer.lookup_transform_full_core("ball", *times, "map")
    assert full.transform.translation.x == pytest.approx(2 * math.cos(TURN))
    assert buffer.can_transform_full_core("ball", *times, "map")[0]
    assert buffer.get_latest_common_time("map", "ball") == Time(seconds=3)
    with pytest.raises(LookupException):
        buffer.get_latest_common_time("map", "nose")
    assert "Frame ball exists with parent map." in buffer.all_frames_as_string()
    assert "ball:" in buffer.all_frames_as_yaml()


# Messages in other frames, at 2 s: turned by TURN and 2 m along x


MOVED = 2 + math.cos(TURN)
HALF = math.sin(0.5 * TURN), math.cos(0.5 * TURN)


@pytest.mark.parametrize(
    ("kind", "moved", "expected"),
    [
        (PointStamped, lambda m: (m.point.x, m.point.y), (MOVED, math.sin(TURN))),
        (Vector3Stamped, lambda m: (m.vector.x, m.vector.y), (math.cos(TURN), math.sin(TURN))),
        (PoseStamped, lambda m: (m.pose.position.x, m.pose.orientation.z), (MOVED, HALF[0])),
    ],
)
def test_each_type_is_turned_and_moved_as_it_should_be(buffer, kind, moved, expected):
    given = stamped(kind)
    for part in ("point", "vector", "pose.position"):
        owner = given
        for name in part.split("."):
            owner = getattr(owner, name, None)
        if owner is not None:
            owner.x = 1.0
    found = buffer.transform(given, "map")
    assert (found.header.frame_id, found.header.stamp.sec) == ("map", 2)
    assert moved(found) == pytest.approx(expected)


def test_a_pose_with_covariance(buffer):
    pose = stamped(PoseWithCovarianceStamped)
    pose.pose.pose.orientation.w = 1.0
    pose.pose.covariance[0] = 4.0  # along x
    pose.pose.covariance[35] = 1.0  # about z
    moved = buffer.transform(pose, "map")
    cos, sin = math.cos(TURN), math.sin(TURN)
    assert moved.pose.covariance[0] == pytest.approx(4 * cos * cos)
    assert moved.pose.covariance[1] == pytest.approx(4 * cos * sin)
    assert moved.pose.covariance[7] == pytest.approx(4 * sin * sin)
    assert moved.pose.covariance[35] == pytest.approx(1.0)


def test_what_transforms_a_type_is_registered_and_can_be_replaced(buffer):
    class Landmark:
        def __init__(self, x):
            self.x = x
            self.header = PointStamped().header
            self.header.frame_id = "ball"

    with pytest.raises(TypeException):
        buffer.transform(Landmark(1.0), "map")
    buffer.registration.add(
        Landmark, lambda mark, found: Landmark(mark.x + found.transform.translation.x)
    )
    assert buffer.transform(Landmark(1.0), "map").x == 4.0
    ours = buffer.registration.get(PointStamped)
    buffer.registration.add(PointStamped, lambda message, found: "theirs")
    point = PointStamped()
    point.header.frame_id = "ball"
    try:
        assert buffer.transform(point, "map") == "theirs"
    finally:
        buffer.registration.add(PointStamped, ours)


def test_directions_and_bare_poses():
    transform = shifted(3.0, 5)
    vector = Vector3Stamped()
    vector.vector.x = 1.0
    assert tf.do_transform_vector3(vector, transform).vector.x == 1.0
    assert transform.transform.translation.x == 3.0  # tf2's sets it to 0
    assert tf.do_transform_pose(Pose(), transform).position.x == 3.0
    with pytest.raises(TypeException):
        tf.TransformRegistration().get(WrenchStamped)


# Waiting


def test_messages_and_full_lookups_wait_as_well(buffer):
    bring = threading.Timer(0.05, buffer.set_transform, [message(7.0, 7)])
    bring.start()
    patience = Duration(seconds=20)
    assert buffer.transform(stamped(PointStamped, seconds=7), "map", patience).point.x == 7.0
    join(bring)
    bring = threading.Timer(0.05, buffer.set_transform, [message(9.0, 9)])
    bring.start()
    found = buffer.lookup_transform_full(
        "map", Time(seconds=1), "ball", Time(seconds=9), "map", patience
    )
    assert found.transform.translation.x == pytest.approx(9.0)
    join(bring)


def test_an_executor_awaits_while_it_works(buffer, threads):
    """Two tasks wait in one thread, and a timer of the same executor brings what they want."""
    node, executor = rclpy.create_node("awaits"), SingleThreadedExecutor()
    tf.TransformListener(buffer, node)
    executor.add_node(node)
    tasks = [
        executor.create_task(buffer.lookup_transform_async, "map", "ball", Time(seconds=second))
        for second in (4, 5)
    ]
    tasks.append(
        executor.create_task(
            buffer.lookup_transform_full_async,
            *("map", Time(seconds=1), "ball", Time(seconds=5), "map"),
        )
    )
    timer = node.create_timer(0.02, lambda: buffer.set_transform(message(7.0, 7)))
    wait_for(lambda: executor.spin_once(timeout_sec=0.1) or all(task.done() for task in tasks))
    assert [t.result().transform.translation.x for t in tasks] == pytest.approx([4, 5, 5])
    timer.cancel()
    executor.shutdown()


# The clock


def test_a_clock_that_jumps_back_clears(buffer):
    clock = ROSClock()

    class Node:
        def get_clock(self):
            return clock

        def create_service(self, *_):
            return None

    buffer = Buffer(node=Node())
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(seconds=100, clock_type=ClockType.ROS_TIME))
    buffer.set_transform(message(1.0, 1))
    clock.set_ros_time_override(Time(seconds=101, clock_type=ClockType.ROS_TIME))
    assert buffer.can_transform("map", "ball", Time())
    clock.set_ros_time_override(Time(seconds=50, clock_type=ClockType.ROS_TIME))
    assert not buffer.can_transform("map", "ball", Time())


def test_times_as_stamps_and_numbers_of_numpy_are_taken_as_tf2_takes_them(buffer):
    given = message(2.0, 5)
    given.header.stamp = Time(seconds=5)
    given.transform.translation.y = np.float32(0.5)
    buffer.set_transform(given)
    found = buffer.lookup_transform("map", "ball", Time(seconds=5))
    assert found.transform.translation.y == 0.5
    deserialize_message(serialize_message(found), TransformStamped)
    point = stamped(PointStamped, seconds=5)
    point.header.stamp = Time(seconds=5)
    point.point.x = np.float32(0.25)
    moved = buffer.transform(point, "map")
    again = deserialize_message(serialize_message(moved), PointStamped)
    assert again.point.x == moved.point.x == pytest.approx(2.0 + 0.25 * math.cos(TURN))
