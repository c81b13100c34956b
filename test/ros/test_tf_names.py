"""What a program for tf2_ros and tf2_geometry_msgs may import and call."""

import pytest
from geometry_msgs.msg import (
    PointStamped,
    Pose,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.time import Time
from transform_messages import shifted

from head_tracking import tf

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


def test_the_names_and_methods_of_tf2_are_there():
    """That an exported name exists is checked in test_architecture.py."""
    assert set(NAMES.split()) <= set(tf.__all__)
    assert set(CORE.split()) <= set(dir(tf.BufferCore))


@pytest.fixture
def buffer():
    buffer = tf.Buffer()
    for second in (1, 2):
        buffer.set_transform(shifted(float(second), second), "someone")
    return buffer


def test_the_core_answers_without_waiting(buffer):
    assert buffer.lookup_transform_core("map", "ball", Time()).transform.translation.x == 2.0
    assert buffer.can_transform_core("map", "ball", Time()) == (True, "")
    possible, reason = buffer.can_transform_core("map", "ball", Time(seconds=9))
    assert not possible
    assert "future" in reason
    two, one = Time(seconds=2), Time(seconds=1)
    full = buffer.lookup_transform_full_core("ball", two, "ball", one, "map")
    assert full.transform.translation.x == -1.0
    assert buffer.can_transform_full_core("ball", two, "ball", one, "map")[0]


def test_what_transforms_a_type_is_registered_and_can_be_replaced(buffer):
    class Landmark:
        def __init__(self, x):
            self.x = x
            self.header = PointStamped().header
            self.header.frame_id = "ball"

    with pytest.raises(tf.TypeException):
        buffer.transform(Landmark(1.0), "map")
    buffer.registration.add(
        Landmark, lambda mark, found: Landmark(mark.x + found.transform.translation.x)
    )
    assert buffer.transform(Landmark(1.0), "map").x == 3.0
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
    with pytest.raises(tf.TypeException):
        tf.TransformRegistration().get(WrenchStamped)
