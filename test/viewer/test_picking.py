"""Where a person points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.transforms import Rotation, Transform
from head_tracking.viewer.camera_picture import point_in_picture
from head_tracking.viewer.other_topics import Picture
from head_tracking.viewer.steering_panel import point_on_ground
from head_tracking.vision.camera import Camera, camera_with_view

SHARE = st.floats(0.0, 1.0)
ANGLE = st.floats(-math.pi, math.pi)


def picture(camera: Camera | None) -> Picture:
    return Picture(1, 2, "camera", np.zeros((240, 320, 3), np.uint8), camera)


@given(st.tuples(SHARE, SHARE), st.tuples(ANGLE, ANGLE, ANGLE), st.floats(0.1, 10.0))
def test_the_camera_sees_the_point_where_it_was_pointed_at(share, rpy, distance):
    camera = Camera(320, 240, 300.0, 310.0, 150.0, 130.0)
    place = Transform((0.1, -0.2, 0.9), Rotation.from_rpy(*rpy))
    point = point_in_picture(picture(camera), share, place, distance, 1.0)
    assert math.dist(point, place.translation) == pytest.approx(distance)
    pixel = camera.pixel(place.inverse() @ point)
    assert pixel == pytest.approx((share[0] * 320 - 0.5, share[1] * 240 - 0.5), abs=1e-6)


def test_without_a_calibration_the_stated_angle_counts():
    right = point_in_picture(picture(None), (1.0, 0.5), Transform.identity(), 2.0, 1.2)
    assert math.atan2(right[0], right[2]) == pytest.approx(0.6, abs=1e-3)
    assert camera_with_view(320, 240, 1.2).ray((159.5, 119.5)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("origin", "direction", "there"),
    [
        ((0.0, 0.0, 2.0), (1.0, 0.5, -1.0), (2.0, 1.0, 0.0)),
        ((0.0, 0.0, 2.0), (1.0, 0.0, 1.0), None),
        ((0.0, 0.0, 2.0), (1.0, 0.0, 0.0), None),
        ((0.0, 0.0, 2.0), (1.0, 0.0, -0.001), None),
        ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    ],
)
def test_the_ground_is_where_a_line_of_sight_meets_it(origin, direction, there):
    found = point_on_ground(origin, direction)
    assert found == (there if there is None else pytest.approx(there))
