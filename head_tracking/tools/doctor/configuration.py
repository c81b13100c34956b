"""doctor looks at parameter files and the robot's model, without ROS."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
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
from head_tracking.share import robot_file
from head_tracking.tools.doctor.findings import Finding, Level
from head_tracking.transforms import RobotModelError, load_robot_model

P = TypeVar("P")

_SLACK: Final = 0.02  # rad


@dataclass(frozen=True, slots=True)
class ConfiguredBus:
    """The servos on one port, as a person has stated them.

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


class UnusableError(Exception):
    """A parameter file cannot be used; says which and why."""


def parameters_of(node: str, files: Sequence[Path]) -> dict[str, Any]:
    """What parameter files say of a node, whatever its namespace; later ones win.

    Raises:
        UnusableError: A file is no YAML, or no parameter file.
    """
    found: dict[str, Any] = {}
    for file in files:
        try:
            content = yaml.safe_load(file.read_text())
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise UnusableError(f"{file}: {' '.join(str(error).split())}") from error
        if content is not None and not isinstance(content, dict):
            raise UnusableError(f"{file}: it must hold nodes and their ros__parameters")
        for values in _sections(content or {}, node, "**"):
            found.update(_flat(values))
    return found


def _sections(content: Mapping[Any, Any], node: str, name: str) -> Iterator[Mapping[Any, Any]]:
    for key, value in content.items():
        if not isinstance(value, dict):
            continue
        if key == "ros__parameters":
            if name in (node, "*", "**"):
                yield value
        else:
            yield from _sections(value, node, str(key).rpartition("/")[2])


def _flat(values: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _read(
    kind: type[P], values: Mapping[str, Any], prefix: str = "", defaults: Mapping[str, Any] = {}
) -> P:
    """One of the node's parameter classes; raises ValueError, as the node would."""
    made = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        default = defaults.get(field.name, field.default)
        name = f"{prefix}{field.name}"
        made[field.name] = (
            checked(name, parameter_info(field), default, values[name])
            if name in values
            else default
        )
    return kind(**made)


def configured_buses(
    files: Sequence[Path], port_name: str = "", baud_rate: int = 0
) -> tuple[ConfiguredBus, ...]:
    """The buses that servo_bus would open.

    Args:
        files: Parameter files; later ones win.
        port_name: In the place of the configured port, unless empty.
        baud_rate: In the place of the configured one, unless 0.

    Raises:
        UnusableError: A file cannot be used.
        ValueError: A parameter is not allowed.
        ConfigurationError: A servo cannot do what is configured.
    """
    values = parameters_of("servo_bus", files)
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


def look_at_configuration(
    files: Sequence[Path], port_name: str = "", baud_rate: int = 0
) -> tuple[Finding, tuple[ConfiguredBus, ...]]:
    """Whether the parameter files can be used, and what they say."""
    names = ", ".join(str(file) for file in files)
    try:
        buses = configured_buses(files, port_name, baud_rate)
    except (UnusableError, ValueError, ConfigurationError) as error:
        cure = f"correct it in {names}; config/head.yaml is an example that works"
        return Finding("configuration", Level.RED, str(error), cure), ()
    joints = [joint for bus in buses for joint in bus.joints]
    told = "; ".join(
        f"{joint.joint_name} {'/'.join(str(each.id) for each in joint.calibrations)}, "
        f"{joint.model.name}"
        for joint in joints
    )
    return Finding("configuration", Level.GREEN, f"joints and ids: {told}"), buses


def look_at_model(robot: str, files: Sequence[Path], buses: Sequence[ConfiguredBus]) -> Finding:
    """Whether the robot's model can be read, is a pan/tilt head, and fits the servos."""
    check = "model"
    cure = "check_model FILE tells more; --robot names another one"
    try:
        model = load_robot_model(robot_file(robot))
    except (RobotModelError, FileNotFoundError) as error:
        return Finding(check, Level.RED, str(error), cure)
    values = parameters_of("head_tracker", files)
    names = {
        key: str(values.get(key, default))
        for key, default in (
            ("head_pan_joint", "head_pan_joint"),
            ("head_tilt_joint", "head_tilt_joint"),
            ("camera_link", "camera_link"),
        )
    }
    try:
        PanTiltHead(
            model,
            pan_joint=names["head_pan_joint"],
            tilt_joint=names["head_tilt_joint"],
            pointing_frame=names["camera_link"],
        )
    except RobotModelError as error:
        return Finding(check, Level.RED, f"{robot}: {error}", cure)
    limits = {name: joint.limits for name, joint in model.joints.items()}
    strangers, narrow = [], []
    for joint in (joint for bus in buses for joint in bus.joints):
        if joint.joint_name not in limits:
            strangers.append(joint.joint_name)
            continue
        allowed = limits[joint.joint_name]
        if joint.lower < allowed.lower - _SLACK or joint.upper > allowed.upper + _SLACK:
            narrow.append(
                f"{joint.joint_name}: servo {joint.lower:.2f} to {joint.upper:.2f} rad, model "
                f"{allowed.lower:.2f} to {allowed.upper:.2f}"
            )
    if strangers:
        return Finding(
            check,
            Level.RED,
            f"{robot} has no joint {', '.join(strangers)}, which a servo is to turn",
            f"set X_controller.joint_name to one of {', '.join(sorted(limits))}",
        )
    if narrow:
        return Finding(
            check,
            Level.AMBER,
            f"a servo may go farther than the model: {'; '.join(narrow)}",
            "narrow motor.min and motor.max, or widen the model's limits",
        )
    return Finding(check, Level.GREEN, f"{robot}: {names['camera_link']} can be pointed")
