"""The model that the robot's nodes get, with a calibration."""

import numpy as np
import pytest
from random_head import kinectbot_geometry

from head_tracking.calibration import Calibration, CalibrationFileError, calibrated
from head_tracking.calibration.geometry import Solution
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherParameters
from head_tracking.run.options import parse_arguments


@pytest.fixture
def file(tmp_path):
    changes = np.array([0.03, 0.05, -0.02, 0.004, 0.003, 0.006, 0.01, 0.0, 0.0, 0.0])
    path = tmp_path / "calibration.yaml"
    Calibration.of(kinectbot_geometry(), Solution(changes, {}, 0.3, 20, 1)).save(path)
    return path


def test_a_run_publishes_the_calibrated_model(file):
    run = parse_arguments(["--sim", "--calibration", str(file)])
    (publisher,) = [node for node in run.nodes if node.name == "robot_state_publisher"]
    model = RobotStatePublisherParameters(**publisher.parameters).model()
    expected = calibrated(kinectbot_geometry().model, file)
    frames = ("neck_link", "camera_optical_frame", {})
    assert np.allclose(
        model.transform(*frames).as_matrix(), expected.transform(*frames).as_matrix()
    )


def test_that_of_another_robot_is_refused(file):
    with pytest.raises(CalibrationFileError):
        RobotStatePublisherParameters(robot="turtlebot", calibration=str(file)).model()
