"""The head looks around a marker by itself, with a simulated camera that is mounted wrong."""

import math

import numpy as np
import pytest

from head_tracking import Head
from head_tracking.calibration import Calibration, calibrated, gathering
from head_tracking.calibration.solver import CalibrationError, Reason
from head_tracking.cli import calibrate
from head_tracking.command_line import DONE, FAILED, REFUSED
from head_tracking.configuration import configured_head
from head_tracking.scene import film
from head_tracking.share import robot_file, robot_parameters
from head_tracking.simulation import SimulatedJoints
from head_tracking.transforms import load_robot_model
from head_tracking.vision import MarkerParameters


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(gathering, "MOST_VIEWS", 13)
    monkeypatch.setattr(gathering, "_SETTLING", 0.15)
    monkeypatch.setattr(gathering, "_SPEED", 2.0)


def test_from_a_wrong_mounting_to_a_right_one(quick, tmp_path):
    output = tmp_path / "camera.yaml"
    arguments = ["camera", "--sim", "--yes", "--output", str(output)]
    assert calibrate.main(arguments) == DONE
    model = load_robot_model(robot_file("kinectbot"))
    found = calibrated(model, output).transform("neck_link", "camera_optical_frame", {})
    true = model.transform("neck_link", "camera_optical_frame", {}) @ calibrate.SIMULATED_MOUNTING
    apart = found.inverse() @ true
    assert 2.0 * np.linalg.norm(apart[3:6]) < np.radians(0.6)  # it was 3.8 degrees
    assert np.linalg.norm(apart.translation) < 0.008  # m; it was 11 mm
    assert Calibration.load(output).views > 8


def test_nothing_moves_before_somebody_agrees(tmp_path):
    output = tmp_path / "camera.yaml"

    def ask(question):
        return "no"

    refused = calibrate.main(["camera", "--sim", "--output", str(output)], ask)
    assert refused == REFUSED
    assert not output.exists()


def test_no_marker_in_view_is_a_failure(quick, tmp_path):
    output = tmp_path / "camera.yaml"
    arguments = ["camera", "--sim", "--yes", "--marker-id", "3", "--output", str(output)]
    assert calibrate.main(arguments) == FAILED
    assert not output.exists()


def test_a_camera_without_pictures_is_named():
    with Head.simulated() as head, pytest.raises(CalibrationError) as refusal:
        head.calibrate([], marker=MarkerParameters("4X4_50", -1, 0.16))
    assert refusal.value.reason is Reason.NO_PICTURE


@pytest.mark.parametrize("degrees", [0.0, 1.0])
def test_the_play_of_simulated_servos_is_found(quick, degrees):
    """The camera hangs on links that stay behind the encoders."""
    model = load_robot_model(robot_file("kinectbot"))
    configured = configured_head(robot_parameters("kinectbot"))
    names = [joint.joint_name for joint in configured.servos]
    with SimulatedJoints(configured.servos, link_play=math.radians(degrees)) as servos:

        def camera(stamp):
            true = {name: servos.true_position(name) for name in names}
            return model.transform("base_link", "camera_optical_frame", true)

        with Head(servos.port_name, model, configured.servos, reply_timeout=0.3) as head:
            found = head.calibrate(
                film("still marker", camera), marker=MarkerParameters("4X4_50", -1, 0.16)
            )
    for name in ("pan play", "tilt play"):
        estimate = found.estimates[name]
        assert estimate.observable
        assert abs(estimate.value - math.radians(degrees)) < math.radians(0.25)
