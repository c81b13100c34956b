"""Files of calibrations, and heads that use them."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from random_head import RESIDUALS, kinectbot_geometry

from head_tracking import Head
from head_tracking.calibration import Calibration, CalibrationFileError, Estimate
from head_tracking.calibration.geometry import HeadGeometry
from head_tracking.cli.doctor.configured import check_calibration
from head_tracking.cli.doctor.findings import Grade
from head_tracking.exceptions import RefusedError
from head_tracking.share import robot_file, write_file
from head_tracking.transforms import load_robot_model, parse_robot_model

CHANGES = np.array([0.03, -0.05, 0.02, 0.004, -0.003, 0.006, 0.01, 0.02, -0.015, 0.025])


@pytest.fixture
def geometry():
    return kinectbot_geometry()


@pytest.fixture
def file(geometry, tmp_path):
    estimates = {"camera pitch": Estimate(0.03, 0.001, True)}
    calibration = Calibration.of(geometry, CHANGES, estimates, 0.3, 20, 1, RESIDUALS)
    calibration.save(tmp_path / "calibration.yaml")
    return tmp_path / "calibration.yaml"


@pytest.mark.parametrize("robot", ["kinectbot", "stretch", "op3"])
def test_the_calibrated_model_agrees_with_the_solver(robot, tmp_path):
    model = load_robot_model(robot_file(robot))
    joints = sorted(name for name in model.independent_joints if "_pan" in name or "_tilt" in name)
    geometry = HeadGeometry(model, *joints, "camera_optical_frame")
    Calibration.of(geometry, CHANGES, {}, 0.3, 20, 1, RESIDUALS).save(tmp_path / "c.yaml")
    model = Calibration.load(tmp_path / "c.yaml").apply(model)
    angles = np.array([(0.0, 0.3), (0.7, -0.2), (-0.4, 0.0)])
    for angle, turn, place in zip(angles, *geometry.cameras(CHANGES, *angles.T), strict=True):
        positions = dict(zip(joints, angle, strict=True))
        found = model.transform(geometry.base, geometry.optical_frame, positions).as_matrix()
        assert np.allclose(found[:3], np.column_stack([turn, place]), atol=1e-9)


def test_a_file_is_what_was_saved(file):
    found = Calibration.load(file)
    assert found.estimates == {"camera pitch": Estimate(0.03, 0.001, True)}
    assert (found.robot, found.noise, found.views, found.left_out) == ("kinectbot", 0.3, 20, 1)
    assert (found.error_before, found.error_after) == pytest.approx((0.1, 0.001))
    assert 0.0 <= found.age < 3600.0
    again = file.with_name("again.yaml")
    found.save(str(again))
    assert Calibration.load(again) == found


@pytest.mark.parametrize("problem", ["full disk", "Ctrl-C"])
def test_a_file_that_is_not_written_leaves_the_earlier_one_and_no_draft(file, problem, monkeypatch):
    calibration, before = Calibration.load(file), file.read_text()
    if problem == "full disk":
        file.with_name(f".{file.name}.{os.getpid()}.draft").symlink_to("/dev/full")
    else:
        monkeypatch.setattr(Path, "replace", lambda *_: signal.raise_signal(signal.SIGINT))
    with pytest.raises((CalibrationFileError, KeyboardInterrupt)):
        calibration.save(file)
    assert file.read_text() == before
    assert list(file.parent.iterdir()) == [file]


def test_two_processes_that_write_one_file_at_once_both_succeed(file, monkeypatch):
    other = (
        "import sys, pathlib, head_tracking.share as share;"
        "share.write_file(pathlib.Path(sys.argv[1]), 'other')"
    )
    replace = Path.replace

    def replace_after_the_other(draft, path):
        subprocess.run([sys.executable, "-c", other, path], check=True, timeout=60)
        return replace(draft, path)

    monkeypatch.setattr(Path, "replace", replace_after_the_other)
    write_file(file, "own")
    assert file.read_text() == "own"
    assert list(file.parent.iterdir()) == [file]


def test_a_file_in_a_read_only_folder_is_written(file, monkeypatch):
    """Else the motion of 90 s was in vain."""
    calibration, write = Calibration.load(file), Path.write_text

    def refuse_drafts(path, text, **options):
        if path != file:
            raise PermissionError(13, "Permission denied")
        return write(path, text, **options)

    file.write_text("")
    monkeypatch.setattr(Path, "write_text", refuse_drafts)
    calibration.save(file)
    assert Calibration.load(file) == calibration


def test_a_device_is_written_and_not_replaced(file):
    pipe = file.with_name("pipe")
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    Calibration.load(file).save(pipe)
    assert os.read(reader, 10_000).decode() == file.read_text()
    os.close(reader)
    assert pipe.is_fifo()


def test_a_head_uses_it(file, geometry):
    with Head.simulated(calibration=file) as head:
        measured = head.pose("camera_optical_frame", geometry.base)
        joints = head.joints
        expected = (
            Calibration.load(file)
            .apply(geometry.model)
            .transform(geometry.base, "camera_optical_frame", joints)
        )
        assert np.allclose(measured.as_matrix(), expected.as_matrix(), atol=1e-6)
        assert head.look_at((2.0, 0.3, 0.5)).arrived
        assert head.calibration is not None
        assert head.calibration.source == file
        assert head.calibration.age < 3600.0
        assert head.calibration.estimates["camera pitch"].deviation == 0.001
        with pytest.raises(RefusedError):  # the result would not fit the model
            head.calibrate()


@pytest.mark.parametrize(
    ("robot", "days", "grade"),
    [
        ("kinectbot", 3, Grade.GREEN),
        ("kinectbot", 400, Grade.AMBER),
        ("kinectbot", -400, Grade.AMBER),
        ("turtlebot", 3, Grade.RED),
        ("no_such_robot", 3, Grade.RED),
    ],
)
def test_the_doctor_grades_it(file, robot, days, grade):
    replace(Calibration.load(file), made=time.time() - 86400.0 * days).save(file)
    finding = check_calibration(robot, file)
    assert (finding.check, finding.level) == ("calibration", grade)
    if days > 0 and grade in (Grade.GREEN, Grade.AMBER):
        assert f"{days} days" in finding.text


@pytest.mark.parametrize("axis", [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
def test_the_doctor_refuses_an_axis_that_the_run_refuses(file, axis):
    document = yaml.safe_load(file.read_text())
    document["joints"]["head_tilt_joint"] |= {"axis": axis, "origin": [0, 0, 0, 0, 0, 0, 1]}
    file.write_text(yaml.safe_dump(document))
    assert check_calibration("kinectbot", file).level is Grade.RED


def test_another_model_is_refused(file, geometry):
    """Also one with the same joints, and the calibrated model itself."""
    calibration = Calibration.load(file)
    other = parse_robot_model(geometry.model.urdf.replace('name="kinectbot"', 'name="other"', 1))
    for model in (other, calibration.apply(geometry.model)):
        with pytest.raises(CalibrationFileError):
            calibration.apply(model)


@pytest.mark.parametrize(
    "damage",
    [
        lambda found: found.pop("joints"),
        lambda found: found.update(noise=float("nan")),
        lambda found: found["estimates"]["camera pitch"].update(deviation=-0.001),
        lambda found: found["joints"]["camera_link_mount"].update(origin=[0.0] * 7),
        lambda found: found["joints"]["camera_link_mount"].update(axis=[0.0]),
        lambda found: found["estimates"].update(x=None),
    ],
)
def test_a_damaged_file_is_refused(file, damage):
    found = yaml.safe_load(file.read_text())
    damage(found)
    file.write_text(yaml.safe_dump(found))
    with pytest.raises(CalibrationFileError):
        Calibration.load(file)


@pytest.mark.parametrize("text", ["", "[1, 2", "7", "{}", pytest.param("[" * 5000, id="deep")])
def test_what_is_no_calibration_is_refused(tmp_path, text):
    path = tmp_path / "other.yaml"
    path.write_text(text)
    with pytest.raises(CalibrationFileError):
        Calibration.load(path)
    with pytest.raises(CalibrationFileError):
        Calibration.load(tmp_path / "nowhere.yaml")
