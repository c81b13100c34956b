import math

import pytest

from head_tracking.transforms import (
    ExtrapolationException,
    InvalidArgumentException,
    Transform,
    TransformBuffer,
)

SECOND = 1_000_000_000


@pytest.fixture
def buffer():
    """A body that circles the origin of `map` at 2 m and 0.5 rad/s, and looks ahead."""
    buffer = TransformBuffer()
    buffer.set_transform(
        0, "world", "map", Transform.from_xyz_rpy((9, 0, 0), (0, 0, 1)), static=True
    )
    for index in range(401):
        angle = 0.5 * index / 100
        buffer.set_transform(
            SECOND + index * SECOND // 100,
            "map",
            "body",
            Transform.from_xyz_rpy(
                (2 * math.cos(angle), 2 * math.sin(angle), 0), (0, 0, angle + math.pi / 2)
            ),
        )
    return buffer


def test_a_body_on_a_circle(buffer):
    found = buffer.lookup_velocity("body", "map", 3 * SECOND, SECOND // 50)
    angle = 0.5 * 2
    assert found.linear == pytest.approx((-math.sin(angle), math.cos(angle), 0), abs=1e-4)
    assert found.angular == pytest.approx((0, 0, 0.5), abs=1e-6)
    assert found.stamp == 3 * SECOND
    assert (found.body_frame, found.reference_frame) == ("body", "map")


def test_the_vectors_in_another_frame(buffer):
    found = buffer.lookup_velocity("body", "map", 3 * SECOND, SECOND // 50, "body")
    assert found.linear == pytest.approx((1, 0, 0), abs=1e-3)
    assert found.angular == pytest.approx((0, 0, 0.5), abs=1e-6)


def test_another_point_of_the_body(buffer):
    at_rest = buffer.lookup_velocity(
        "body", "map", 3 * SECOND, SECOND // 50, "map", (0.0, 2.0, 0.0), "body"
    )
    assert at_rest.linear == pytest.approx((0, 0, 0), abs=1e-3)  # the middle of the circle
    outside = buffer.lookup_velocity(
        "body", "map", 3 * SECOND, SECOND // 50, "body", (0.0, -2.0, 0.0), "body"
    )
    assert outside.linear == pytest.approx((2, 0, 0), abs=1e-3)


def test_what_never_moves_has_no_velocity(buffer):
    found = buffer.lookup_velocity("map", "world", 3 * SECOND, SECOND)
    assert found.linear == found.angular == (0, 0, 0)


def test_a_time_before_the_history_is_refused(buffer):
    with pytest.raises(ExtrapolationException):
        buffer.lookup_velocity("body", "map", SECOND, SECOND)


def test_no_interval_is_refused(buffer):
    with pytest.raises(InvalidArgumentException):
        buffer.lookup_velocity("body", "map", 0, 0)


def test_near_time_zero_the_interval_is_cut_as_in_tf2():
    buffer = TransformBuffer()
    for index in range(101):
        place = Transform.from_xyz_rpy((0.02 * index, 0, 0), (0, 0, 0.01 * index))
        buffer.set_transform(index * SECOND // 100, "map", "body", place)
    found = buffer.lookup_velocity("body", "map", SECOND // 20, SECOND // 5)
    assert found.linear == pytest.approx((2, 0, 0))
    assert found.angular == pytest.approx((0, 0, 1))
    with pytest.raises(ExtrapolationException):
        buffer.lookup_velocity("body", "map", 1, 2)


def test_the_vector_of_a_spinning_frame_is_turned_once():
    """tf2 turns it by the frame's own rotation once more, and gives (-1, 0, 0) here."""
    buffer = TransformBuffer()
    for index in range(201):
        place = Transform.from_xyz_rpy((0, 0.01 * index, 0), (0, 0, 3.14159265 / 2))
        buffer.set_transform(SECOND + index * SECOND // 100, "map", "body", place)
    found = buffer.lookup_velocity("body", "map", 2 * SECOND, SECOND // 50)
    assert found.linear == pytest.approx((0, 1, 0), abs=1e-6)
