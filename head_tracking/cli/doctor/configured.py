"""Checks of doctor: parameter files, robot model and calibration, without ROS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from head_tracking.calibration import Calibration, CalibrationFileError, summary
from head_tracking.cli.doctor.findings import Finding, Grade
from head_tracking.configuration import ConfiguredBus, configured_buses, head_parameters
from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze.pan_tilt_head import UNLIMITED
from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model

_SLACK: Final = 0.02  # rad


def check_configured(
    files: Sequence[Path], port_name: str = "", baud_rate: int = 0
) -> tuple[Finding, tuple[ConfiguredBus, ...]]:
    """Check the parameters of servo_bus, and return its buses; see `configured_buses`."""
    try:
        buses = configured_buses(files, port_name, baud_rate)
    except HeadTrackingError as error:
        text = f"{error}; correct it in {', '.join(map(str, files))}"
        return Finding("configuration", Grade.RED, text), ()
    servos = "; ".join(
        f"{joint.joint_name} {'/'.join(str(each.id) for each in joint.calibrations)}, "
        f"{joint.model.name}"
        for bus in buses
        for joint in bus.joints
    )
    return Finding("configuration", Grade.GREEN, f"joints and ids: {servos}"), buses


def check_model(robot: str, files: Sequence[Path], buses: Sequence[ConfiguredBus]) -> Finding:
    """Check that the robot model is valid, has a pan/tilt head, and fits the servos."""
    try:
        head_parameters("point_head", files)
        parameters = head_parameters("head_tracker", files)
        model = load_robot_model(robot_file(robot))
        servos = {each.joint_name: (each.lower, each.upper) for bus in buses for each in bus.joints}
        pan, tilt = parameters.head_pan_joint, parameters.head_tilt_joint
        parameters.within(servos.get(pan, UNLIMITED), servos.get(tilt, UNLIMITED)).head(model)
    except HeadTrackingError as error:
        return Finding("model", Grade.RED, str(error))
    problems, level = [], Grade.GREEN
    for joint in (joint for bus in buses for joint in bus.joints):
        in_model = model.joints.get(joint.joint_name)
        if in_model is None:
            problems.append(f"it has no joint {joint.joint_name}; it has {', '.join(model.joints)}")
            level = Grade.RED
            continue
        lower, upper = in_model.limits.lower, in_model.limits.upper
        if joint.lower < lower - _SLACK or joint.upper > upper + _SLACK:
            problems.append(
                f"the limits of {joint.joint_name}, {lower:.3g} to {upper:.3g} rad, are narrower "
                f"than its servo's motor.min and motor.max, {joint.lower:.3g} to {joint.upper:.3g}"
            )
            level = max(level, Grade.AMBER)
    text = "; ".join(problems) or f"{parameters.pointed} can be pointed"
    return Finding("model", level, f"{robot}: {text}")


def check_calibration(robot: str, path: Path, files: Sequence[Path] = ()) -> Finding:
    """Check that a calibrated head can be pointed; report age and deviations of the file."""
    try:
        calibration = Calibration.load(path)
        model = calibration.apply(load_robot_model(robot_file(robot)))
        head_parameters("head_tracker", files).head(model)
    except CalibrationFileError as error:
        return Finding("calibration", Grade.RED, str(error))
    except HeadTrackingError as error:
        return Finding("calibration", Grade.RED, f"{path}: with it the head cannot run: {error}")
    text = f"{path}: {calibration.age_text}; {calibration.views} views"
    for name, change, deviation in summary(calibration):
        text += f"; {name} {change} {deviation}"
    return Finding("calibration", Grade.AMBER if calibration.is_old else Grade.GREEN, text)
