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
    joints_by_port,
)
from head_tracking.configuration.head_nodes import HEAD_NODES
from head_tracking.dynamixel import (
    ConfigurationError,
    EepromSettings,
    JointConfiguration,
    check_configuration,
)
from head_tracking.dynamixel.configuration import TemperatureParameters
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.parameter_files import (
    COMMAND_LINE,
    Given,
    read,
    unknown_nodes,
    unknown_parameters,
)
from head_tracking.parameters import ParameterError, changed, nearest

P = TypeVar("P")


@dataclass(frozen=True, slots=True)
class ConfiguredBus:
    """The configured servos of one port; baud_rate in bits, update_rate in cycles per second."""

    port_name: str
    baud_rate: int
    update_rate: float
    joints: tuple[JointConfiguration, ...]
    temperature: TemperatureParameters


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
    head = head_parameters("point_head", files)
    pan, tilt = head.head_pan_joint, head.head_tilt_joint
    for bus in configured_buses(files):
        joints = {joint.joint_name: joint for joint in bus.joints}
        if {pan, tilt} <= joints.keys():
            return ConfiguredHead((joints[pan], joints[tilt]), bus.baud_rate, head.pointed)
    raise ConfigurationError(
        f"no bus has servos for both {pan} and {tilt}; see servo_bus and head_pan_joint in "
        f"{', '.join(map(str, files))}"
    )


def head_parameters(node: str, files: Sequence[Path]) -> HeadParameters:
    """Return the parameters of the head that point_head or head_tracker has with parameter files.

    Raises:
        ParameterFileError: a file cannot be read.
        ParameterError: a value is not allowed, or a parameter does not exist.
    """
    values = _Values(node, files)
    for kind in HEAD_NODES[node]:
        values.read(kind)
    values.check_names()
    return values.read(HeadParameters)


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
    values.read(EepromSettings, "eeprom.")  # only ~/write_eeprom uses them
    joints: list[tuple[ControllerParameters, JointConfiguration]] = []
    for name in p.dynamixels:
        prefix = f"{name}_controller."
        controller = values.read(ControllerParameters, prefix, {"joint_name": f"{name}_joint"})
        motor = values.read(MotorParameters, f"{prefix}motor.", TUTORIAL_HEAD.get(name, {}))
        second = values.read(SecondMotorParameters, f"{prefix}second_motor.")
        joints.append((controller, configured_joint(name, controller, motor, second)))
    values.check_names()
    return tuple(
        ConfiguredBus(port, baud, p.update_rate, check_configuration(found), temperature)
        for port, (baud, found) in joints_by_port(p, joints).items()
    )


class _Values:
    """The values of a node, whatever its namespace.

    Args:
        node: its name.
        files: parameter files; later ones win.
        others: values that win over files, unless they are empty or 0.

    Raises:
        ParameterError: the files have nodes of this name in several namespaces.
    """

    def __init__(self, node: str, files: Sequence[Path], others: Mapping[str, Any] = {}) -> None:
        self._node = node
        self._known = {"use_sim_time", "start_type_description_service", "frame_prefix"}
        self._of_all_nodes = [given for file in files for given in read(str(file))]
        own = [given for given in self._of_all_nodes if given.node in (node, "")]
        places = dict.fromkeys(one.nodes for one in own if one.node and "*" not in one.nodes)
        if len(places) > 1:
            raise ParameterError(
                f"{', '.join(map(str, files))}: these are nodes of several heads: "
                f"{', '.join(places)}; give the files of one head"
            )
        own += [Given(COMMAND_LINE, "", name, value) for name, value in others.items() if value]
        self._given = {given.name: given for given in own}

    def read(self, kind: type[P], prefix: str = "", defaults: Mapping[str, Any] = {}) -> P:
        """Make a parameter class; raise ParameterError if a value is not allowed."""
        self._known.update(f"{prefix}{field.name}" for field in dataclasses.fields(kind))  # type: ignore[arg-type]
        values = {name: given.value for name, given in self._given.items()}
        return changed(
            kind(**defaults), values, prefix, where=lambda name: f"{self._given[name].file}: "
        )

    def check_names(self) -> None:
        """Raise ParameterError if a file names a node or a parameter that does not exist."""
        problems = [
            *unknown_nodes(self._of_all_nodes, ("servo_bus", *HEAD_NODES)),
            *(
                f"{given.file}: {self._node} has no parameter {given.name}"
                f"{nearest(given.name, self._known)}"
                for given in unknown_parameters(self._given.values(), self._known)
            ),
        ]
        if problems:
            raise ParameterError("; ".join(problems))
