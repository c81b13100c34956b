import math

import numpy as np
import pytest

from head_tracking.transforms import Rotation
from head_tracking.vision import Box, Camera, CameraError, camera_with_view

K = [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0]


def test_a_pixel_and_a_depth_make_a_point_and_back():
    camera = Camera.from_calibration((640, 480), K)
    point = camera.point((420.0, 138.0), 2.0)
    assert point == pytest.approx((0.4, -0.4, 2.0))
    assert camera.pixel(point) == pytest.approx((420.0, 138.0))
    assert camera.pixel((0.0, 0.0, -1.0)) is None


def test_binning_and_a_region_change_the_pixels_but_not_the_directions():
    whole = Camera.from_calibration((640, 480), K)
    part = Camera.from_calibration((640, 480), K, binning=(2, 2), region=(100, 40, 400, 200))
    assert (part.width, part.height) == (200, 100)
    assert part.ray((60.0, 50.0)) == pytest.approx(whole.ray((220.0, 140.0)))


@pytest.mark.parametrize(
    ("model", "distortion"),
    [
        ("plumb_bob", (-0.28, 0.07, 1e-3, -5e-4, 0.01)),
        ("rational_polynomial", (0.5, -0.2, 1e-4, 2e-4, 0.02, 0.6, -0.1, 0.03)),
        ("equidistant", (-0.02, 0.005, -0.003, 0.0005)),
    ],
)
@pytest.mark.parametrize(("x", "y"), [(0.31, -0.22), (-0.6, -0.45), (-0.2, 0.45)])
def test_distortion_is_undone(model, distortion, x, y):
    camera = Camera.from_calibration((640, 480), K, distortion, model)
    r2 = x * x + y * y
    if model == "equidistant":
        r = math.sqrt(r2)
        t = math.atan(r)
        k1, k2, k3, k4 = distortion
        bent = t * (1 + k1 * t**2 + k2 * t**4 + k3 * t**6 + k4 * t**8) / r
        u, v = x * bent, y * bent
    else:
        k1, k2, p1, p2, k3, k4, k5, k6 = (*distortion, 0.0, 0.0, 0.0)[:8]
        radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    pixel = (500.0 * u + 320.0, 510.0 * v + 240.0)
    assert camera.ray(pixel) == pytest.approx((x, y), abs=1e-6)
    assert camera.pixel((1.7 * x, 1.7 * y, 1.7)) == pytest.approx(pixel, abs=1e-3)


P = [480.0, 0.0, 330.0, 0.0, 0.0, 480.0, 235.0, 0.0, 0.0, 0.0, 1.0, 0.0]
BENT = (-0.28, 0.07, 1e-3, -5e-4, 0.01)
TURN = Rotation.from_rpy(0.02, -0.05, 0.01).as_matrix()


def test_rectified_images_use_p_only():
    camera = Camera.from_calibration(
        (640, 480), K, BENT, turn=TURN.ravel().tolist(), projection=P, rectified=True
    )
    assert camera.ray((330.0 + 48.0, 235.0 - 96.0)) == pytest.approx((0.1, -0.2))
    assert camera.pixel((0.2, -0.4, 2.0)) == pytest.approx((378.0, 139.0))


@pytest.mark.parametrize(
    ("model", "distortion"),
    [("plumb_bob", ()), ("plumb_bob", BENT), ("equidistant", (0.0,) * 4)],  # 0: no distortion
)
def test_raw_images_are_turned_into_the_frame_of_rectified_ones(model, distortion):
    straight = Camera.from_calibration((640, 480), K, distortion, model)
    turned = Camera.from_calibration((640, 480), K, distortion, model, turn=TURN.ravel().tolist())
    pixel = (411.0, 187.0)
    x, y, z = TURN @ (*straight.ray(pixel), 1.0)
    assert turned.ray(pixel) == pytest.approx((x / z, y / z))
    assert turned.pixel((2.0 * x, 2.0 * y, 2.0 * z)) == pytest.approx(pixel, abs=1e-3)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"distortion": (0.1, 0.2, 0.3)}, "plumb_bob"),
        ({"distortion": (0.1,) * 6, "model": "rational_polynomial"}, "rational_polynomial"),
        ({"distortion": (0.1,) * 5, "model": "equidistant"}, "equidistant"),
        ({"distortion": (0.1, 0.0), "model": "magic"}, "magic"),
        ({"distortion": (math.nan,) * 5}, "D"),
        ({"turn": [2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]}, "R"),
        ({"turn": [math.nan] * 9}, "R"),
        ({"turn": [1.0, 0.0]}, "R"),
        ({"rectified": True}, "P"),
        ({"rectified": True, "projection": [0.0] * 12}, "640x480"),
        ({"size": (0, 0), "k": [0.0] * 9, "model": ""}, "0x0"),
        ({"k": [0.0] * 9}, "640x480"),
        ({"k": [math.nan, *K[1:]]}, "K"),
        ({"k": K[:6]}, "K"),
    ],
)
def test_an_invalid_calibration_is_refused(wrong, named):
    with pytest.raises(CameraError, match=rf"\b({named})\b"):
        Camera.from_calibration(**({"size": (640, 480), "k": K} | wrong))


def test_the_view_of_a_simulated_camera():
    camera = camera_with_view(640, 480, 1.0)
    left, right = camera.ray((-0.5, 239.5)), camera.ray((639.5, 239.5))
    assert math.atan(right[0]) - math.atan(left[0]) == pytest.approx(1.0)


def test_boxes():
    box = Box(10, 20, 30, 40)
    assert box.centre == (25, 40)
    assert box.grown(2.0) == Box(-5, 0, 60, 80)
    assert box.grown(2.0).clipped(50, 60) == Box(0, 0, 50, 60)
    assert box.clipped(5, 5)[2:] == (0, 0)
    assert np.zeros((60, 50))[box.slices()].shape == (40, 30)


@pytest.mark.parametrize("x", [1.3, 2.0])
def test_points_outside_the_distortion_model_are_not_projected(x):
    camera = Camera.from_calibration((640, 480), K, (-0.4, 0.0, 0.0, 0.0, 0.0))
    pixel = camera.pixel((x, 0.0, 1.0))
    assert pixel is None or not 0 <= pixel[0] < 640


@pytest.mark.parametrize("view", [60, 3.2, 0.0, -1.0, math.nan])
def test_a_field_of_view_in_degrees_is_refused(view):
    """It would be a mirrored camera, and the head would turn away from its target."""
    with pytest.raises(CameraError, match="radians"):
        camera_with_view(640, 480, view)
