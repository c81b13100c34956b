"""The model that the robot's nodes get, with a calibration."""

import re
import time
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from random_head import RESIDUALS, kinectbot_geometry
from rclpy.parameter import Parameter
from waiting import wait_for

from head_tracking.calibration import Calibration
from head_tracking.calibration.geometry import Estimate
from head_tracking.ros.kit.diagnostics import Level, health_from_message
from head_tracking.ros.robot.robot_state_publisher import (
    RobotStatePublisherNode,
    RobotStatePublisherParameters,
)
from head_tracking.run.options import parse_arguments


@pytest.fixture
def file(tmp_path):
    changes = np.array([0.03, 0.05, -0.02, 0.004, 0.003, 0.006, 0.01, 0.0, 0.0, 0.0])
    path = tmp_path / "calibration.yaml"
    Calibration.of(kinectbot_geometry(), changes, {}, 0.3, 20, 1, RESIDUALS).save(path)
    return path


def test_a_run_publishes_the_calibrated_model(file):
    run = parse_arguments(["--sim", "--calibration", str(file)])
    (publisher,) = [node for node in run.nodes if node.name == "robot_state_publisher"]
    model = RobotStatePublisherParameters(**publisher.parameters).model()
    expected = Calibration.load(file).apply(kinectbot_geometry().model)
    frames = ("neck_link", "camera_optical_frame", {})
    assert np.allclose(
        model.transform(*frames).as_matrix(), expected.transform(*frames).as_matrix()
    )


def test_diagnostics_tell_its_values_deviations_age_and_source(threads, file, tmp_path):
    made = replace(
        Calibration.load(file),
        made=time.time() - 400 * 86_400,
        estimates={"camera pitch": Estimate(0.02, 0.001, True)},
    )
    made.save(tmp_path / "aged.yaml")
    said: list[DiagnosticArray] = []
    given = [Parameter("calibration", value=str(tmp_path / "aged.yaml"))]
    node = RobotStatePublisherNode(parameter_overrides=given)
    node.create_subscription(DiagnosticArray, "/diagnostics", said.append, 10)
    threads.start(node)
    wait_for(lambda: said)
    health = health_from_message(said[0].status[0])
    assert health.name == "robot_state_publisher: calibration"
    assert health.level is Level.WARN
    assert "400" in health.message
    assert health.values["source"] == str(tmp_path / "aged.yaml")
    assert re.match(r"\+1\.15 degrees ± 0\.06", health.values["camera pitch"])
