"""The ROS face of the transform library."""

import math

import pytest
from geometry_msgs.msg import PointStamped, TransformStamped
from rclpy.time import Time

from head_tracking.tf import (
    Buffer,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformBroadcaster,
    TransformException,
    broadcasting_possible,
)
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns


def message(x: float, seconds: int = 1, parent: str = "map", child: str = "ball"):
    transform = TransformStamped()
    transform.header.stamp.sec = seconds
    transform.header.frame_id = parent
    transform.child_frame_id = child
    transform.transform.translation.x = x
    transform.transform.rotation.z = math.sin(0.25)
    transform.transform.rotation.w = math.cos(0.25)
    return transform


@pytest.fixture
def buffer():
    buffer = Buffer()
    buffer.set_transform(message(1.0, 1))
    buffer.set_transform(message(3.0, 3))
    return buffer


def test_what_goes_in_comes_out(buffer):
    for time, expected in ((Time(seconds=1), message(1.0, 1)), (Time(), message(3.0, 3))):
        found = buffer.lookup_transform("map", "ball", time)
        assert found.header == expected.header
        assert found.child_frame_id == "ball"
        assert found.transform.translation == expected.transform.translation
        assert found.transform.rotation.z == pytest.approx(expected.transform.rotation.z)
        assert found.transform.rotation.w == pytest.approx(expected.transform.rotation.w)


def test_a_time_between_is_interpolated(buffer):
    found = buffer.lookup_transform("map", "ball", Time(seconds=2))
    assert found.transform.translation.x == pytest.approx(2.0)
    assert found.header.stamp.sec == 2


def test_a_point_is_transformed_at_its_stamp(buffer):
    point = PointStamped()
    point.header.frame_id = "ball"
    point.header.stamp.sec = 1
    point.point.x = 1.0
    moved = buffer.transform(point, "map")
    assert moved.header.frame_id == "map"
    assert moved.header.stamp.sec == 1
    assert (moved.point.x, moved.point.y) == pytest.approx((1 + math.cos(0.5), math.sin(0.5)))


def test_static_transforms_hold_at_any_time(buffer):
    buffer.set_transform_static(message(7.0, 0, "world", "map"))
    assert buffer.can_transform("world", "map", Time(seconds=99))
    assert buffer.can_transform("world", "ball", Time(seconds=2))


def test_errors_are_tf2s(buffer):
    with pytest.raises(LookupException):
        buffer.lookup_transform("map", "nose", Time())
    with pytest.raises(ExtrapolationException):
        buffer.lookup_transform("map", "ball", Time(seconds=4))
    assert issubclass(LookupException, TransformException)


def test_a_quaternion_that_is_none_is_refused(buffer):
    bad = message(1.0, 5)
    bad.transform.rotation.w = 9.0
    with pytest.raises(InvalidArgumentException, match="norm"):
        buffer.set_transform(bad)
    assert buffer.lookup_transform("map", "ball", Time()).header.stamp.sec == 3


@pytest.mark.parametrize("nanoseconds", [0, 1, 999_999_999, 1_795_222_262_440_843_580])
def test_stamps_round_trip(nanoseconds):
    assert stamp_to_ns(ns_to_stamp(nanoseconds)) == nanoseconds


def test_a_listener_follows_the_robot(pointing_robot):
    core = pointing_robot.composition.buffer.core
    latest = core.lookup_transform("base_link", "camera_link").stamp
    found = pointing_robot.composition.buffer.lookup_transform(
        "base_link", "camera_link", Time(nanoseconds=latest)
    )
    assert stamp_to_ns(found.header.stamp) == latest


@pytest.mark.skipif(broadcasting_possible(), reason="tf2_msgs is installed")
def test_without_tf2_msgs_broadcasting_says_what_to_install(pointing_robot):
    with pytest.raises(ImportError, match="ros-jazzy-tf2-msgs"):
        TransformBroadcaster(pointing_robot.node)
