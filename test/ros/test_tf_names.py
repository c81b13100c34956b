"""What a program for tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs may import and call."""

import numpy as np
import pytest
from geometry_msgs.msg import (
    Point32,
    PointStamped,
    Polygon,
    PolygonStamped,
    Pose,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.duration import Duration
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2, PointField
from transform_messages import shifted

from head_tracking import tf

NAMES = """
    Buffer BufferCore BufferInterface TransformListener StaticTransformListener
    TransformBroadcaster StaticTransformBroadcaster TransformRegistration
    ConvertRegistration convert Stamped TypeException TransformException
    LookupException ConnectivityException ExtrapolationException InvalidArgumentException
    TimeoutException DEFAULT_TF_TOPIC DEFAULT_STATIC_TF_TOPIC
    do_transform_point do_transform_vector3 do_transform_pose do_transform_pose_stamped
    do_transform_pose_with_covariance_stamped do_transform_polygon_stamped transform_covariance
    to_msg_msg from_msg_msg do_transform_cloud transform_points
"""
CORE = """
    set_transform set_transform_static clear can_transform_core can_transform_full_core
    lookup_transform_core lookup_transform_full_core get_latest_common_time lookupVelocityCore
    lookupVelocityFullCore all_frames_as_yaml all_frames_as_string _frameExists _getFrameStrings
"""


@pytest.mark.parametrize("name", NAMES.split())
def test_a_name_of_tf2_can_be_imported(name):
    assert hasattr(tf, name)
    assert name in tf.__all__


@pytest.mark.parametrize("name", CORE.split())
def test_a_buffer_has_the_methods_of_tf2s_core(name):
    assert callable(getattr(tf.BufferCore(Duration(seconds=5)), name))


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
    half = Duration(seconds=0.5)
    linear, angular = buffer.lookupVelocityCore("ball", "map", Time(seconds=2), half)
    assert linear == pytest.approx((1, 0, 0))
    assert angular == pytest.approx((0, 0, 0))
    full_velocity = buffer.lookupVelocityFullCore(
        "ball", "map", "map", (0.0, 0.0, 0.0), "ball", Time(seconds=2), half
    )
    assert full_velocity[0] == pytest.approx((1, 0, 0))
    assert buffer._frameExists("ball")
    assert buffer._getFrameStrings() == ["ball", "map"]


def test_registered_types_are_transformed_and_converted(buffer):
    class Landmark:
        def __init__(self, x):
            self.x = x

    class Place(Landmark):
        pass

    mark = tf.Stamped(Landmark(1.0), Time(seconds=2).to_msg(), "ball")
    with pytest.raises(tf.TypeException):
        buffer.transform(mark, "map")
    buffer.registration.add(
        Landmark, lambda mark, found: Landmark(mark.x + found.transform.translation.x)
    )
    assert buffer.transform(mark, "map").x == 3.0
    with pytest.raises(tf.TypeException):
        buffer.transform(mark, "map", new_type=Place)
    tf.ConvertRegistration().add_convert((Landmark, Place), lambda mark: Place(mark.x))
    assert type(buffer.transform(mark, "map", new_type=Place)) is Place
    assert tf.convert(mark, Landmark) is not mark


def test_a_program_of_its_own_may_replace_what_transforms_a_message(buffer):
    ours = buffer.registration.get(PointStamped)
    buffer.registration.add(PointStamped, lambda message, found: "theirs")
    try:
        assert (
            buffer.transform(tf.Stamped(PointStamped(), Time().to_msg(), "ball"), "map") == "theirs"
        )
    finally:
        buffer.registration.add(PointStamped, ours)


def test_directions_bare_poses_and_polygons():
    transform = shifted(3.0, 5)
    vector = Vector3Stamped()
    vector.vector.x = 1.0
    assert tf.do_transform_vector3(vector, transform).vector.x == 1.0
    assert transform.transform.translation.x == 3.0  # tf2's sets it to 0
    assert tf.do_transform_pose(Pose(), transform).position.x == 3.0
    corners = Polygon(points=[Point32(x=1.0), Point32(y=2.0)])
    moved = tf.do_transform_polygon_stamped(PolygonStamped(polygon=corners), transform)
    assert [(p.x, p.y) for p in moved.polygon.points] == [(4.0, 0.0), (3.0, 2.0)]
    assert tf.transform_covariance(np.eye(6).ravel(), transform) == pytest.approx(np.eye(6).ravel())
    assert tf.transform_points([[1, 2, 3]], transform).tolist() == [[4, 2, 3]]
    with pytest.raises(tf.TypeException):
        tf.TransformRegistration().get(WrenchStamped)


def cloud(points, *, big: bool = False, padding: int = 0) -> PointCloud2:
    """x, y, z and an intensity between them, in rows of two points."""
    order = ">" if big else "<"
    layout = [("x", "f4"), ("i", "u2"), ("y", "f4"), ("z", "f8"), ("", "V2")]
    kind = np.dtype(
        [(name or "pad", order + code if code != "V2" else code) for name, code in layout]
    )
    rows = b""
    for start in range(0, len(points), 2):
        row = np.zeros(2, kind)
        for name, column in zip("xyz", np.transpose(points[start : start + 2]), strict=True):
            row[name] = column
        row["i"] = 7
        rows += row.tobytes() + bytes(padding)
    numbers = {"f4": PointField.FLOAT32, "f8": PointField.FLOAT64, "u2": PointField.UINT16}
    return PointCloud2(
        height=len(points) // 2,
        width=2,
        fields=[
            PointField(name=name, offset=kind.fields[name][1], datatype=numbers[code], count=1)
            for name, code in layout
            if name
        ],
        is_bigendian=big,
        point_step=kind.itemsize,
        row_step=2 * kind.itemsize + padding,
        data=rows,
    )


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 5])
def test_a_cloud_is_moved_and_keeps_its_other_fields(big, padding):
    points = [[1, 2, 3], [4, 5, 6], [7, 8, 9], [0, 0, 1]]
    moved = tf.do_transform_cloud(cloud(points, big=big, padding=padding), shifted(3.0, 5))
    expected = [[x + 3.0, y, z] for x, y, z in points]
    assert bytes(moved.data) == bytes(cloud(expected, big=big, padding=padding).data)
    assert (moved.header.frame_id, moved.row_step) == ("map", 2 * moved.point_step + padding)


def test_a_cloud_that_does_not_fit_its_data_is_refused():
    bad = cloud([[1, 2, 3], [4, 5, 6]])
    bad.height = 9
    with pytest.raises(tf.TypeException):
        tf.do_transform_cloud(bad, shifted(3.0, 5))
    bad = cloud([[1, 2, 3], [4, 5, 6]])
    bad.fields = bad.fields[:2]
    with pytest.raises(tf.TypeException):
        tf.do_transform_cloud(bad, shifted(3.0, 5))
