"""doctor checks parameter files and the robot's model, without ROS."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import yaml

from head_tracking.dynamixel import (
    BusSettings,
    ConfigurationError,
    JointConfiguration,
    check_configuration,
)
from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze import PanTiltHead
from head_tracking.parameters import checked, parameter_info
from head_tracking.ros.bus_parameters import (
    TUTORIAL_HEAD,
    ControllerParameters,
    MotorParameters,
    SecondMotorParameters,
    ServoBusParameters,
    TemperatureParameters,
    bus_settings,
    configured_joint,
)
from head_tracking.ros.parameter_files import read
from head_tracking.share import robot_file
from head_tracking.tools.doctor.findings import Finding, Level
from head_tracking.transforms import load_robot_model

P = TypeVar("P")

_SLACK: Final = 0.02  # rad


@dataclass(frozen=True, slots=True)
class ConfiguredBus:
    """The servos that are configured on one port.

    Attributes:
        port_name: Device.
        baud_rate: Bits per second.
        update_rate: Cycles per second.
        joints: The joints.
        settings: Temperatures, among others.
    """

    port_name: str
    baud_rate: int
    update_rate: float
    joints: tuple[JointConfiguration, ...]
    settings: BusSettings


def check_configured(
    files: Sequence[Path], port_name: str = "", baud_rate: int = 0
) -> tuple[Finding, tuple[ConfiguredBus, ...]]:
    """Check that servo_bus can use the parameter files, and return the buses that it would open.

    Args:
        files: Parameter files; later ones win.
        port_name: Replaces the configured port, unless empty.
        baud_rate: Replaces the configured one, unless 0.
    """
    try:
        buses = _configured_buses(files, port_name, baud_rate)
    except (OSError, ValueError, yaml.YAMLError, ConfigurationError) as error:
        reason = " ".join(str(error).split())
        text = f"{reason}; correct it in {', '.join(map(str, files))}"
        return Finding("configuration", Level.RED, text), ()
    servos = "; ".join(
        f"{joint.joint_name} {'/'.join(str(each.id) for each in joint.calibrations)}, "
        f"{joint.model.name}"
        for bus in buses
        for joint in bus.joints
    )
    return Finding("configuration", Level.GREEN, f"joints and ids: {servos}"), buses


def check_model(robot: str, files: Sequence[Path], buses: Sequence[ConfiguredBus]) -> Finding:
    """Check that the robot's model can be read, has a pan/tilt head, and fits the servos."""
    values = {
        "head_pan_joint": "head_pan_joint",
        "head_tilt_joint": "head_tilt_joint",
        "camera_link": "camera_link",
    } | _parameters_of("head_tracker", files)
    try:
        model = load_robot_model(robot_file(robot))
        names = (values["head_pan_joint"], values["head_tilt_joint"], values["camera_link"])
        PanTiltHead(model, *names)
    except HeadTrackingError as error:
        return Finding("model", Level.RED, str(error))
    problems, level = [], Level.GREEN
    for joint in (joint for bus in buses for joint in bus.joints):
        in_model = model.joints.get(joint.joint_name)
        if in_model is None:
            problems.append(f"it has no joint {joint.joint_name}; it has {', '.join(model.joints)}")
            level = Level.RED
            continue
        lower, upper = in_model.limits.lower, in_model.limits.upper
        if joint.lower < lower - _SLACK or joint.upper > upper + _SLACK:
            problems.append(
                f"the limits of {joint.joint_name}, {lower:.2f} to {upper:.2f} rad, are narrower "
                f"than its servo's motor.min and motor.max, {joint.lower:.2f} to {joint.upper:.2f}"
            )
            level = max(level, Level.AMBER)
    text = "; ".join(problems) or f"{values['camera_link']} can be pointed"
    return Finding("model", level, f"{robot}: {text}")


def _configured_buses(
    files: Sequence[Path], port_name: str, baud_rate: int
) -> tuple[ConfiguredBus, ...]:
    values = _parameters_of("servo_bus", files)
    if port_name:
        values["port_name"] = port_name
    if baud_rate:
        values["baud_rate"] = baud_rate
    p = _read(ServoBusParameters, values)
    settings = bus_settings(p, _read(TemperatureParameters, values, "temperature."))
    buses: dict[tuple[str, int], list[JointConfiguration]] = {}
    for name in p.dynamixels:
        prefix = f"{name}_controller."
        controller = _read(ControllerParameters, values, prefix, {"joint_name": f"{name}_joint"})
        motor = _read(MotorParameters, values, f"{prefix}motor.", TUTORIAL_HEAD.get(name, {}))
        second = _read(SecondMotorParameters, values, f"{prefix}second_motor.")
        bus = (controller.port_name or p.port_name, controller.baud_rate or p.baud_rate)
        buses.setdefault(bus, []).append(configured_joint(name, controller, motor, second))
    return tuple(
        ConfiguredBus(port, baud, p.update_rate, check_configuration(joints), settings)
        for (port, baud), joints in buses.items()
    )


def _read(
    kind: type[P], values: Mapping[str, Any], prefix: str = "", defaults: Mapping[str, Any] = {}
) -> P:
    """Return a parameter class as the node makes it; raise ValueError where the node refuses."""
    made = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        default = defaults.get(field.name, field.default)
        name = f"{prefix}{field.name}"
        value = values.get(name, default)
        made[field.name] = checked(name, parameter_info(field), default, value)
    return kind(**made)


def _parameters_of(node: str, files: Sequence[Path]) -> dict[str, Any]:
    """Return the parameters of a node in files, whatever its namespace; later files win."""
    return {
        given.name: given.value
        for file in files
        for given in read(str(file))
        if given.node in (node, "")
    }
