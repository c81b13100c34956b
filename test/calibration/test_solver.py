"""What views of a marker tell of a camera's mounting; the truth is known."""

import itertools
import math

import numpy as np
import pytest
from random_head import CAMERA, SIZE, changes_of, kinectbot_geometry, pointing_error, random_head

from head_tracking.calibration.geometry import PARAMETERS, HeadGeometry
from head_tracking.calibration.solver import CalibrationError, Reason, View, solve
from head_tracking.calibration.targets import observer
from head_tracking.cli.calibrate import SIMULATED_MOUNTING
from head_tracking.scene.render import Renderer
from head_tracking.scene.scenes import make_scene
from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model
from head_tracking.vision import MarkerParameters, camera_with_view
from head_tracking.vision.candidate import Frame
from head_tracking.vision.images import Picture

ZEROS = ("pan zero", "tilt zero")


@pytest.fixture(scope="module")
def geometry():
    return kinectbot_geometry()


@pytest.mark.parametrize(
    ("seed", "noise", "points", "play"),
    [
        (142, 0.5, 0, 0.5),
        (142, 0.5, 1, 2.0),
        (100, 1.0, 12, 0.0),
    ],
)
def test_the_errors_of_a_head_are_found(geometry, seed, noise, points, play):
    """From views of a marker, of one point (a face), and of points of a room; play in degrees."""
    head = random_head(geometry, seed, noise, play=math.radians(play), points=points)
    solution = solve(geometry, CAMERA, head.views, None if points else SIZE)
    assert solution.error_after < 0.5 * solution.error_before
    assert pointing_error(geometry, head, np.zeros(10)) > math.radians(0.5)
    assert pointing_error(geometry, head, changes_of(solution)) < math.radians(0.3)
    inside = []
    for name, truth in zip((each.name for each in PARAMETERS), head.changes, strict=True):
        estimate = solution.estimates.get(name)
        if estimate is not None and estimate.observable:
            inside.append(abs(estimate.value - truth) < 3.0 * estimate.deviation)
    assert np.mean(inside) > 0.85
    assert not any(solution.estimates[name].observable for name in ZEROS)
    assert not changes_of(solution)[8:10].any()
    for name in ("pan play", "tilt play"):
        found = solution.estimates[name]
        assert found.observable
        assert abs(found.value - math.radians(play)) < 3.5 * found.deviation
        assert found.deviation < math.radians(0.12 if noise < 1.0 else 0.3)


def test_the_focal_length_is_found(geometry):
    head = random_head(geometry, 120, 0.3)
    longer = [
        view._replace(corners=(view.corners - (319.5, 239.5)) * 1.03 + (319.5, 239.5))
        for view in head.views
    ]
    solution = solve(geometry, CAMERA, longer, SIZE, focal_length=True)
    found = solution.estimates["focal length"]
    assert found.observable
    assert found.value == pytest.approx(math.log(1.03), abs=4.0 * found.deviation)
    assert found.deviation < 0.02
    narrower = 2.0 * math.atan(math.tan(0.5) / math.exp(found.value))
    assert solution.angle_of_view(1.0) == pytest.approx(narrower)


def test_the_intervals_hold_for_corners_that_are_detected():
    """Their errors are alike in many views."""
    model = load_robot_model(robot_file("two_ax_12"))
    geometry = HeadGeometry(model, "head_pan_joint", "head_tilt_joint", "camera_optical_frame")
    camera = camera_with_view(320, 240, math.radians(60.0))
    renderer = Renderer(make_scene("still marker", np.random.default_rng(1)), camera)
    observe = observer("marker", MarkerParameters(marker_size=SIZE))
    views = []
    for pan, tilt in itertools.product(np.linspace(-0.2, 0.6, 5), np.linspace(-0.65, -0.05, 5)):
        joints = {"head_pan_joint": pan, "head_tilt_joint": tilt}
        pose = model.transform("base_link", "camera_optical_frame", joints) @ SIMULATED_MOUNTING
        picture = renderer.render(pose, 0.0, depth=False).picture
        found = observe(Frame(0, camera, Picture(picture)))
        views += [View(pan, tilt, number, corners) for number, corners in found.items()]
    pitch = solve(geometry, camera, views, SIZE).estimates["camera pitch"]
    assert pitch.value == pytest.approx(0.02, abs=3.0 * pitch.deviation)


def test_joints_that_are_read_less_exactly_increase_the_deviations(geometry):
    head, rng = random_head(geometry, 142, 0.5), np.random.default_rng(1)
    rough = [
        view._replace(
            pan=view.pan + rng.normal(0.0, 0.003), tilt=view.tilt + rng.normal(0.0, 0.003)
        )
        for view in head.views
    ]
    before, after = (
        solve(geometry, CAMERA, views, SIZE).estimates["pan play"].deviation
        for views in (head.views, rough)
    )
    assert after > 1.4 * before


def test_a_wrong_marker_size_is_refused(geometry):
    """The distance of the marker is not observable in these views; the scale is."""
    with pytest.raises(CalibrationError) as refusal:
        solve(geometry, CAMERA, random_head(geometry, 6009, 0.5).views, 1.25 * SIZE)
    assert refusal.value.reason is Reason.FAR_FROM_MODEL


@pytest.mark.parametrize("points", [0, 1])
def test_a_sight_that_moves_is_refused(geometry, points):
    """One point does not tell a motion from blurred images."""
    views = random_head(geometry, 130, 0.5, points=points).views
    half = len(views) // 2
    slipped = [
        view if index < half else view._replace(corners=view.corners + np.array((3.0, 7.0)))
        for index, view in enumerate(views)
    ]
    with pytest.raises(CalibrationError) as refusal:
        solve(geometry, CAMERA, slipped, None if points else SIZE)
    assert refusal.value.reason in {Reason.MOVED} | ({Reason.BLURRED} if points == 1 else set())


def test_points_of_a_room_that_are_confused_are_left_out(geometry):
    """They are no motion."""
    head, rng = random_head(geometry, 40_000, 1.0, points=12), np.random.default_rng(40_000)
    views = [
        view._replace(corners=view.corners + rng.normal(0.0, 30.0 * (rng.random() < 0.15), (1, 2)))
        for view in head.views
    ]
    solution = solve(geometry, CAMERA, views, None)
    assert solution.left_out > 20
    assert pointing_error(geometry, head, changes_of(solution)) < math.radians(0.3)


def test_a_few_blurred_views_are_left_out(geometry):
    head = random_head(geometry, 132, 0.5)
    rng = np.random.default_rng(1)
    views = [
        view._replace(corners=view.corners + rng.normal(0.0, 20.0, (4, 2)) * (index in (3, 9)))
        for index, view in enumerate(head.views)
    ]
    solution = solve(geometry, CAMERA, views, SIZE)
    assert solution.left_out == 2
    assert pointing_error(geometry, head, changes_of(solution)) < math.radians(0.3)


@pytest.mark.parametrize(
    ("spread", "reasons"),
    [
        (5.0, {Reason.INCONSISTENT, Reason.MOVED}),  # a loose camera
        (15.0, {Reason.INCONSISTENT, Reason.MOVED, Reason.BLURRED}),  # a person
    ],
)
def test_inconsistent_views_are_refused(geometry, spread, reasons):
    rng = np.random.default_rng(2)
    views = [
        view._replace(corners=view.corners + rng.normal(0.0, spread, 2))
        for view in random_head(geometry, 133, 0.5).views
    ]
    with pytest.raises(CalibrationError) as refusal:
        solve(geometry, CAMERA, views, SIZE)
    assert refusal.value.reason in reasons


def test_a_camera_that_is_loose_on_one_side_is_refused(geometry):
    """Most of the views agree; none of the others is an outlier by itself."""
    views = random_head(geometry, 7006, 0.5).views
    shifts = np.zeros((5, 2))
    shifts[:, 0] = np.random.default_rng(7006).uniform(-12.0, 12.0, 5)
    left = min(view.pan for view in views)
    loose = [
        view._replace(corners=view.corners + shifts[min(round(5.0 * (view.pan - left)), 4)])
        for view in views
    ]
    with pytest.raises(CalibrationError) as refusal:
        solve(geometry, CAMERA, loose, SIZE)
    assert refusal.value.reason is Reason.INCONSISTENT


@pytest.mark.parametrize(
    ("points", "turn"),
    [
        (0, ((-1, 0), (0, -1))),  # upside down
        (6, ((0, -1), (1, 0))),  # on its side
        (1, ((-1, 0), (0, 1))),  # the images, or the direction of pan
        (0, ((1, 0), (0, -1))),  # the direction of tilt
    ],
)
def test_a_camera_that_is_mounted_in_another_way_is_refused(geometry, points, turn):
    middle = (CAMERA.cx, CAMERA.cy)
    views = [
        view._replace(corners=(view.corners - middle) @ np.array(turn).T + middle)
        for view in random_head(geometry, 130, 0.5, points=points).views
    ]
    for count in (len(views) // 3, len(views)):  # such a target leaves the image soon
        with pytest.raises(CalibrationError):
            solve(geometry, CAMERA, views[:count], None if points else SIZE)


def test_few_views_are_refused(geometry):
    with pytest.raises(CalibrationError) as refusal:
        solve(geometry, CAMERA, random_head(geometry, 134, 0.5).views[:5], SIZE)
    assert refusal.value.reason is Reason.FEW_VIEWS


def test_the_noise_of_a_face_is_not_overestimated(geometry):
    """A face gives two numbers a view, and the errors of the readings hide in these."""
    heads = [random_head(geometry, seed, 2.0, points=1) for seed in range(3)]
    found = [solve(geometry, CAMERA, head.views, None).noise for head in heads]
    assert np.median(found) == pytest.approx(2.0, rel=0.2)
