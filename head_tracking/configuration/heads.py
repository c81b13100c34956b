"""The buses and the head that parameter files describe."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from head_tracking.configuration.bus_parameters import (
    TUTORIAL_HEAD,
    ControllerParameters,
    MotorParameters,
    SecondMotorParameters,
    ServoBusParameters,
    TemperatureParameters,
    bus_settings,
    configured_joint,
)
from head_tracking.configuration.parameter_files import parameters_of
from head_tracking.dynamixel import (
    BusSettings,
    ConfigurationError,
    JointConfiguration,
    check_configuration,
)
from head_tracking.parameters import checked, parameter_info

P = TypeVar("P")


@dataclass(frozen=True, slots=True)
class ConfiguredBus:
    """The configured servos of one port.

    Attributes:
        port_name: device.
        baud_rate: bits per second.
        update_rate: cycles per second.
        joints: the joints.
        settings: watchdog, timeouts and temperatures.
    """

    port_name: str
    baud_rate: int
    update_rate: float
    joints: tuple[JointConfiguration, ...]
    settings: BusSettings


@dataclass(frozen=True, slots=True)
class ConfiguredHead:
    """A head on one bus.

    Attributes:
        servos: of pan and tilt.
        baud_rate: of their bus [bit/s].
        pointing_frame: the link that is pointed.
    """

    servos: tuple[JointConfiguration, JointConfiguration]
    baud_rate: int
    pointing_frame: str


def configured_head(files: Sequence[Path]) -> ConfiguredHead:
    """Return the head that parameter files describe; without files the tutorials' head.

    Raises:
        ConfigurationError: no bus has the servos of pan and tilt.
        ParameterFileError: a file cannot be read.
        ParameterError: a value is not allowed.
    """
    pan, tilt, frame = head_names("point_head", files)
    for bus in configured_buses(files):
        joints = {joint.joint_name: joint for joint in bus.joints}
        if {pan, tilt} <= joints.keys():
            return ConfiguredHead((joints[pan], joints[tilt]), bus.baud_rate, frame)
    raise ConfigurationError(
        f"no bus has servos for both {pan} and {tilt}; see servo_bus and head_pan_joint in "
        f"{', '.join(map(str, files))}"
    )


def head_names(node: str, files: Sequence[Path]) -> tuple[str, str, str]:
    """Return the names of the pan joint, the tilt joint and the pointed frame of a node.

    Args:
        node: point_head or head_tracker.
        files: parameter files; later ones win.

    Raises:
        ParameterFileError: a file cannot be read.
    """
    values = parameters_of(node, files)
    pan, tilt = (values.get(name, name) for name in ("head_pan_joint", "head_tilt_joint"))
    return pan, tilt, values.get("camera_link") or values.get("pointing_frame", "camera_link")


def configured_buses(
    files: Sequence[Path], port_name: str = "", baud_rate: int = 0
) -> tuple[ConfiguredBus, ...]:
    """Return the buses that servo_bus opens with parameter files.

    Args:
        files: parameter files; later ones win.
        port_name: replaces the configured port, unless empty.
        baud_rate: replaces the configured one, unless 0.

    Raises:
        ConfigurationError: a servo does not support its configuration.
        ParameterFileError: a file cannot be read.
        ParameterError: a value is not allowed.
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


def _read(
    kind: type[P], values: Mapping[str, Any], prefix: str = "", defaults: Mapping[str, Any] = {}
) -> P:
    """Make a parameter class from values; raise ParameterError if one is not allowed."""
    arguments = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        default = defaults.get(field.name, field.default)
        name = f"{prefix}{field.name}"
        value = values.get(name, default)
        arguments[field.name] = checked(name, parameter_info(field), default, value)
    return kind(**arguments)
