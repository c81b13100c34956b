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
    configured_joint,
)
from head_tracking.dynamixel import (
    BusSettings,
    ConfigurationError,
    EepromSettings,
    JointConfiguration,
    check_configuration,
)
from head_tracking.dynamixel.configuration import TemperatureParameters
from head_tracking.parameter_files import COMMAND_LINE, Given, given_to, read
from head_tracking.parameters import (
    ParameterError,
    checked,
    parameter_info,
    unknown,
    unknown_node,
)

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
        ParameterError: a value is not allowed, or a parameter does not exist.
    """
    _check_nodes(files)
    pan, tilt, frame = head_names("point_head", files)
    for bus in configured_buses(files):
        joints = {joint.joint_name: joint for joint in bus.joints}
        if {pan, tilt} <= joints.keys():
            return ConfiguredHead((joints[pan], joints[tilt]), bus.baud_rate, frame)
    raise ConfigurationError(
        f"no bus has servos for both {pan} and {tilt}; see servo_bus and head_pan_joint in "
        f"{', '.join(map(str, files))}"
    )


def _check_nodes(files: Sequence[Path]) -> None:
    """Raise ParameterError if a file misspells a node; else its values would be left out."""
    for file in files:
        for node in {given.node for given in read(str(file))}:
            if problem := unknown_node(node, ("servo_bus", "point_head", "head_tracker")):
                raise ParameterError(f"{file}: {problem}")


def head_names(node: str, files: Sequence[Path]) -> tuple[str, str, str]:
    """Return the names of the pan joint, the tilt joint and the pointed frame of a node.

    Args:
        node: point_head or head_tracker.
        files: parameter files; later ones win.

    Raises:
        ParameterFileError: a file cannot be read.
    """
    values = {name: given.value for name, given in given_to(node, files).items()}
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
        ParameterError: a value is not allowed, or a parameter does not exist.
    """
    values = _Values("servo_bus", files, {"port_name": port_name, "baud_rate": baud_rate})
    p = values.read(ServoBusParameters)
    temperature = values.read(TemperatureParameters, "temperature.")
    settings = BusSettings(p.command_timeout, p.bus_watchdog, temperature)
    values.read(EepromSettings, "eeprom.")  # only ~/write_eeprom uses them
    buses: dict[tuple[str, int], list[JointConfiguration]] = {}
    for name in p.dynamixels:
        prefix = f"{name}_controller."
        controller = values.read(ControllerParameters, prefix, {"joint_name": f"{name}_joint"})
        motor = values.read(MotorParameters, f"{prefix}motor.", TUTORIAL_HEAD.get(name, {}))
        second = values.read(SecondMotorParameters, f"{prefix}second_motor.")
        bus = (controller.port_name or p.port_name, controller.baud_rate or p.baud_rate)
        buses.setdefault(bus, []).append(configured_joint(name, controller, motor, second))
    values.check_names()
    return tuple(
        ConfiguredBus(port, baud, p.update_rate, check_configuration(joints), settings)
        for (port, baud), joints in buses.items()
    )


class _Values:
    """The values of a node.

    Args:
        node: its name.
        files: parameter files; later ones win.
        others: values that win over files, unless they are empty or 0.
    """

    def __init__(self, node: str, files: Sequence[Path], others: Mapping[str, Any]) -> None:
        winning = {
            name: Given(COMMAND_LINE, "", name, value) for name, value in others.items() if value
        }
        self._node, self._given = node, given_to(node, files) | winning
        self._known = {"use_sim_time"}

    def read(self, kind: type[P], prefix: str = "", defaults: Mapping[str, Any] = {}) -> P:
        """Make a parameter class; raise ParameterError if a value is not allowed."""
        arguments = {}
        for field in dataclasses.fields(kind):  # type: ignore[arg-type]
            default = defaults.get(field.name, field.default)
            name = f"{prefix}{field.name}"
            self._known.add(name)
            given = self._given.get(name)
            try:
                value = default if given is None else given.value
                arguments[field.name] = checked(name, parameter_info(field), default, value)
            except ParameterError as error:
                file = "" if given is None else f"{given.file}: "
                raise ParameterError(f"{file}{error}") from None
        return kind(**arguments)

    def check_names(self) -> None:
        """Raise ParameterError if a file names a parameter that does not exist."""
        for name, given in self._given.items():
            problem = unknown(name, self._known, self._given)
            if given.node and problem:  # without a node it may be for another one
                raise ParameterError(f"{given.file}: {self._node} {problem}")
