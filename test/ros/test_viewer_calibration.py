"""The page's button that calibrates the camera, over real topics, without a browser."""

from typing import Any

import pytest
from robot_under_test import Robot
from viewing import view
from waiting import wait_for

from head_tracking.calibration import Calibration, gathering
from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.calibrating import CameraCalibration
from head_tracking.ros.kit.diagnostics import Level, Part
from head_tracking.run.node_sets import CAMERA

pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")


@pytest.fixture(scope="module")
def robot(make_module_robot) -> Robot:
    return make_module_robot("--target", "none", "--viewer")


@pytest.fixture(scope="module")
def seen(robot) -> Any:
    """The robot as the page sees it, with a camera in front of a marker."""
    seen = view(robot.threads, alone=False).robot
    robot.threads.start(CAMERA.make({"buffer": robot.composition.buffer}))
    wait_for(lambda: seen.modes.value("simulated_camera", "scene") is not None)
    seen.modes.set_value("simulated_camera", "scene", "still marker")
    wait_for(lambda: seen.topics.picture("/image") is not None)
    return seen


@pytest.fixture
def calibration(robot, seen, monkeypatch, tmp_path) -> CameraCalibration:
    """A short calibration, with the head in the middle, where it sees the marker."""
    seen.modes.centre()
    wait_for(lambda: abs(robot.true("head_pan_joint")) + abs(robot.true("head_tilt_joint")) < 0.1)
    monkeypatch.setattr(gathering, "LONGEST", 250.0)  # a busy machine needs longer
    monkeypatch.setattr(gathering, "MOST_VIEWS", 10)
    monkeypatch.setattr(gathering, "_SETTLING", 0.2)
    monkeypatch.setattr(gathering, "_SPEED", 3.0)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return CameraCalibration(seen, lambda _: seen.topics.picture("/image"))


def ended(calibration: CameraCalibration) -> bool:
    return not calibration.progress.runs


def test_a_marker_without_a_size_is_refused(calibration):
    for size in (0.0, float("nan")):
        with pytest.raises(ValueError, match="allowed"):
            calibration.begin(size, "")
    assert ended(calibration)


def test_a_model_that_is_calibrated_already_is_left_alone(seen, calibration, monkeypatch):
    used = Part("robot_state_publisher: calibration", Level.OK, "3 days old", ())
    monkeypatch.setattr(seen.topics, "health", lambda: (used,))
    with pytest.raises(HeadTrackingError):
        calibration.begin(0.16, "")
    assert ended(calibration)


def test_a_file_that_cannot_be_written_is_refused_before_the_head_moves(
    calibration, tmp_path, monkeypatch
):
    moved = []
    monkeypatch.setattr(gathering, "calibrate_camera", moved.append)
    (tmp_path / "head_tracking" / "calibration" / "kinectbot.yaml").mkdir(parents=True)
    calibration.begin(0.16, "")
    wait_for(lambda: ended(calibration))
    assert "kinectbot.yaml" in calibration.progress.text
    assert not moved


def test_the_head_looks_around_and_writes_what_it_has_measured(robot, seen, calibration, tmp_path):
    usual = seen.modes.value("point_head", "max_velocity")
    calibration.begin(0.16, "")
    with pytest.raises(HeadTrackingError):
        calibration.begin(0.16, "")
    wait_for(lambda: ended(calibration))
    (file,) = tmp_path.rglob("*.yaml")
    assert str(file) in calibration.progress.text
    found = Calibration.load(file)
    assert found.robot == "kinectbot"
    assert found.views >= 8
    assert abs(found.estimates["camera yaw"].value) < 0.02  # rad: it sits as the model says
    assert [name for name, *_ in calibration.progress.rows] == list(found.estimates)
    wait_for(lambda: seen.modes.value("point_head", "max_velocity") == (usual or 2.0))


@pytest.mark.parametrize("what", ["stop", "torque"])
def test_stop_and_a_relaxed_joint_end_it(robot, seen, calibration, what, tmp_path):
    calibration.begin(0.16, "")
    wait_for(lambda: "direction 2" in calibration.progress.text)
    if what == "stop":
        robot.call("stop")  # on a busy computer it may not be confirmed in time, but it counts
    else:
        seen.joints.set_torque("head_tilt_controller", False)
    wait_for(lambda: ended(calibration))
    assert not list(tmp_path.rglob("*.yaml"))
    if what == "torque":
        assert "head_tilt_joint" in calibration.progress.text
        seen.joints.set_torque("head_tilt_controller", True)
        wait_for(lambda: not any(servo.refuses for servo in seen.joints.servos()))
    else:
        with pytest.raises(HeadTrackingError):
            calibration.begin(0.16, "")
        robot.until_done("resume")
        wait_for(lambda: not seen.stop.stopped)
