"""The buffer with messages in and out."""

import math
import threading

import numpy as np
import pytest
from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    QuaternionStamped,
    TransformStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.clock import ClockType, ROSClock
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from std_msgs.msg import Header
from waiting import join

from head_tracking.tf import (
    Buffer,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
    TypeException,
)
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns

TURN = 0.5


def message(x: float, seconds: int = 1, parent: str = "map", child: str = "ball"):
    transform = TransformStamped()
    transform.header.stamp.sec = seconds
    transform.header.frame_id = parent
    transform.child_frame_id = child
    transform.transform.translation.x = x
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


# What goes in comes out


@pytest.mark.parametrize("nanoseconds", [0, 1, 999_999_999, 1_795_222_262_440_843_580])
def test_stamps_round_trip(nanoseconds):
    assert stamp_to_ns(ns_to_stamp(nanoseconds)) == nanoseconds
    assert stamp_to_ns(Time(nanoseconds=nanoseconds)) == nanoseconds


def test_the_messages_are_those_that_the_constructors_make(buffer):
    found = buffer.lookup_transform("map", "ball", Time(seconds=1, nanoseconds=5))
    expected = message(found.transform.translation.x, 1)
    expected.header.stamp.nanosec = 5
    expected.transform.rotation = found.transform.rotation
    assert found == expected
    assert repr(found) == repr(expected)
    for part in (found, found.header, found.header.stamp, found.transform):
        assert [getattr(part, slot.lstrip("_")) for slot in part.get_fields_and_field_types()]

    moved = buffer.transform(stamped(PointStamped), "map")
    again = PointStamped(
        header=Header(stamp=ns_to_stamp(2_000_000_000), frame_id="map"),
        point=Point(x=moved.point.x, y=moved.point.y, z=moved.point.z),
    )
    assert moved == again
    assert repr(moved) == repr(again)


def test_a_message_from_a_lookup_can_be_changed(buffer):
    found = buffer.lookup_transform("map", "ball", Time())
    found.header.frame_id = "elsewhere"
    found.transform.translation.x = 9.0
    assert buffer.lookup_transform("map", "ball", Time()).transform.translation.x == 3.0


def test_times_are_those_of_rclpy_or_of_messages(buffer):
    for time in (Time(seconds=2), Time(seconds=2).to_msg()):
        found = buffer.lookup_transform("map", "ball", time)
        assert found.transform.translation.x == pytest.approx(2.0)
        assert found.header.stamp.sec == 2


def test_a_quaternion_that_is_none_is_refused(buffer):
    bad = message(1.0, 5)
    bad.transform.rotation.w = 9.0
    with pytest.raises(InvalidArgumentException):
        buffer.set_transform(bad)
    assert buffer.lookup_transform("map", "ball", Time()).header.stamp.sec == 3


def test_the_cache_time_is_kept():
    buffer = Buffer(cache_time=Duration(seconds=1))
    for second in (1, 2, 5, 6):
        buffer.set_transform(message(1.0, second))
    assert not buffer.can_transform("map", "ball", Time(seconds=2))
    assert buffer.can_transform("map", "ball", Time(seconds=5))


# Lookups


@pytest.mark.parametrize(
    ("target", "source", "time", "error"),
    [
        ("map", "nose", Time(), LookupException),
        ("map", "island", Time(), ConnectivityException),
        ("map", "ball", Time(seconds=4), ExtrapolationException),
        ("map", "ball", Time(nanoseconds=1), ExtrapolationException),
        ("/map", "ball", Time(), InvalidArgumentException),
        ("", "ball", Time(), InvalidArgumentException),
    ],
)
def test_errors_are_those_of_tf2(buffer, target, source, time, error):
    buffer.set_transform_static(message(0.0, 0, "sea", "island"))
    with pytest.raises(error) as caught:
        buffer.lookup_transform(target, source, time)
    assert isinstance(caught.value, TransformException)
    reason = str(caught.value)
    assert buffer.can_transform(target, source, time, return_debug_tuple=True) == (False, reason)
    assert buffer.can_transform(target, source, time) is False


def test_a_full_lookup_goes_through_two_times(buffer):
    buffer.set_transform_static(message(0.0, 0, "map", "stand"))
    found = buffer.lookup_transform_full(
        "ball", Time(seconds=1), "ball", Time(seconds=3), "map", Duration()
    )
    assert found.header.stamp.sec == 1
    # two metres along x of the map, seen from a frame that is turned
    moved = found.transform.translation
    assert (moved.x, moved.y) == pytest.approx((2 * math.cos(TURN), -2 * math.sin(TURN)))
    arguments = ("ball", Time(seconds=1), "ball", Time(seconds=9), "map")
    assert buffer.can_transform_full(*arguments) is False
    possible, reason = buffer.can_transform_full(*arguments, return_debug_tuple=True)
    assert not possible
    assert "9.0" in reason


def test_the_latest_common_time(buffer):
    assert buffer.get_latest_common_time("map", "ball") == Time(seconds=3)
    with pytest.raises(LookupException):
        buffer.get_latest_common_time("map", "nose")


def test_the_frames_are_told(buffer):
    assert "Frame ball exists with parent map." in buffer.all_frames_as_string()
    assert "ball:" in buffer.all_frames_as_yaml()


# Messages in other frames, at 2 s: turned by TURN and 2 m along x


def test_a_point(buffer):
    point = stamped(PointStamped)
    point.point.x = 1.0
    moved = buffer.transform(point, "map")
    assert (moved.header.frame_id, moved.header.stamp.sec) == ("map", 2)
    expected = (2 + math.cos(TURN), math.sin(TURN), 0.0)
    assert (moved.point.x, moved.point.y, moved.point.z) == pytest.approx(expected)
    waited = buffer.transform(point, "map", Duration(seconds=1))
    assert waited == moved


@pytest.mark.parametrize(
    ("kind", "moved"),
    [
        (Vector3Stamped, lambda m: (m.vector.x, m.vector.y, 0.0)),
        (PoseStamped, lambda m: (m.pose.position.x, m.pose.orientation.z, 0.0)),
        (QuaternionStamped, lambda m: (m.quaternion.z, m.quaternion.w, 0.0)),
        (TransformStamped, lambda m: (m.transform.translation.x, m.transform.rotation.z, 0.0)),
    ],
)
def test_each_type_is_turned_and_moved_as_it_should_be(buffer, kind, moved):
    given = stamped(kind)
    for part in ("vector", "pose.position", "transform.translation"):
        owner = given
        for name in part.split("."):
            owner = getattr(owner, name, None)
        if owner is not None:
            owner.x = 1.0
    expected = {
        Vector3Stamped: (math.cos(TURN), math.sin(TURN), 0.0),
        QuaternionStamped: (math.sin(0.5 * TURN), math.cos(0.5 * TURN), 0.0),
    }.get(kind, (2 + math.cos(TURN), math.sin(0.5 * TURN), 0.0))
    found = buffer.transform(given, "map")
    assert found.header.frame_id == "map"
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


def test_a_message_at_another_time(buffer):
    point = stamped(PointStamped, seconds=3)
    moved = buffer.transform_full(point, "ball", Time(seconds=1), "map")
    assert (moved.header.frame_id, moved.header.stamp.sec) == ("ball", 1)
    assert (moved.point.x, moved.point.y) == pytest.approx(
        (2 * math.cos(TURN), -2 * math.sin(TURN))
    )


def test_what_cannot_be_transformed(buffer):
    with pytest.raises(TypeException):
        buffer.transform(stamped(WrenchStamped), "map")


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


def test_a_pose_has_the_quaternion_whose_w_is_not_below_zero(buffer):
    pose = stamped(PoseStamped)
    pose.pose.orientation.w = -1.0
    turned = buffer.transform(pose, "map").pose.orientation
    assert (turned.z, turned.w) == pytest.approx((math.sin(0.5 * TURN), math.cos(0.5 * TURN)))
