"""The configuration of servos and joints as ROS parameters, by the tutorials' names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from rclpy.node import Node

from head_tracking.dynamixel import (
    ConfigurationError,
    JointConfiguration,
    ServoCalibration,
    servo_model,
)
from head_tracking.parameters import ParameterError, parameter
from head_tracking.ros.parameters import NodeParameters


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """A joint that a servo turns."""

    joint_name: str = parameter("", "The joint that the servo turns.", fixed=True)
    joint_speed: float = parameter(
        2.0, "Speed for commands that give none.", unit="rad/s", minimum=0.02, maximum=12.0
    )
    max_speed: float = parameter(
        0.0,
        "Highest speed ever asked of the servo; 0 for what its model can do.",
        unit="rad/s",
        minimum=0.0,
        maximum=12.0,
    )
    port_name: str = parameter(
        "", "Serial port of the servo; empty for the node's port_name.", fixed=True
    )
    baud_rate: int = parameter(
        0,
        "Speed of that port; 0 for the node's baud_rate.",
        unit="bit/s",
        minimum=0,
        maximum=4_500_000,
        fixed=True,
    )


@dataclass(frozen=True, slots=True)
class MotorParameters:
    """The servo of a joint; `min` above `max` says that it is mounted the other way round."""

    model: str = parameter("AX-12", "Model of the servo, such as XM430-W350.", fixed=True)
    id: int = parameter(-1, "Id of the servo on the bus.", minimum=-1, maximum=253, fixed=True)
    init: int = parameter(512, "Where the joint is at 0.", unit="ticks", fixed=True)
    min: int = parameter(0, "The joint's lower limit.", unit="ticks")
    max: int = parameter(1023, "The joint's upper limit.", unit="ticks")


@dataclass(frozen=True, slots=True)
class SecondMotorParameters:
    """The other servo of a joint that two of them drive, of the same model."""

    id: int = parameter(
        -1, "Id of the second servo; -1: none.", minimum=-1, maximum=253, fixed=True
    )
    init: int = parameter(512, "Where the joint is at 0.", unit="ticks", fixed=True)
    min: int = parameter(0, "The joint's lower limit.", unit="ticks", fixed=True)
    max: int = parameter(1023, "The joint's upper limit.", unit="ticks", fixed=True)


class DeclaredJoint(NamedTuple):
    """A joint and the bus that it is on.

    Attributes:
        configuration: how it is wired.
        port_name: serial port; empty for the node's.
        baud_rate: speed of that port; 0 for the node's.
    """

    configuration: JointConfiguration
    port_name: str
    baud_rate: int


_TUTORIAL_HEAD: dict[str, dict[str, Any]] = {
    "head_pan": {"id": 1},
    "head_tilt": {"id": 2, "min": 300, "max": 800},
}

OnController = Callable[[str, ControllerParameters], None]
OnMotor = Callable[[str, MotorParameters], None]


def declare_joint(
    node: Node,
    dynamixel: str,
    on_controller: OnController,
    on_motor: OnMotor,
    check_motor: OnMotor,
) -> DeclaredJoint:
    """Declares the parameters `<dynamixel>_controller.*` and reads them.

    Args:
        node: declares the parameters.
        dynamixel: the servo's name in the list `dynamixels`.
        on_controller: called with the joint and its parameters when somebody changes a speed.
        on_motor: called with the joint and its parameters when somebody changes a limit.
        check_motor: called before that; raises ConfigurationError if the limit cannot be set.

    Raises:
        ConfigurationError: the servo can't do what is configured, or has no id.
        ParameterError: a parameter is out of range.
    """
    controller = f"{dynamixel}_controller"
    joint_name = f"{dynamixel}_joint"
    made: list[JointConfiguration] = []

    def check_speeds(changed: ControllerParameters) -> None:
        _refuse_impossible(
            lambda: replace(
                made[0], joint_speed=changed.joint_speed, max_speed=changed.max_speed or None
            )
        )

    def check_limits(changed: MotorParameters) -> None:
        _refuse_impossible(lambda: replace(made[0], min=changed.min, max=changed.max))
        _refuse_impossible(lambda: check_motor(joint.joint_name, changed))

    parameters = NodeParameters(
        node,
        ControllerParameters,
        f"{controller}.",
        {"joint_name": joint_name},
        lambda changed: on_controller(changed.joint_name, changed),
        check_speeds,
    )
    joint = parameters.value
    motor = NodeParameters(
        node,
        MotorParameters,
        f"{controller}.motor.",
        _TUTORIAL_HEAD.get(dynamixel),
        lambda changed: on_motor(joint.joint_name, changed),
        check_limits,
    ).value
    if motor.id < 0:
        raise ConfigurationError(
            f"the servo {dynamixel!r} has no id; set the parameter {controller}.motor.id"
        )
    model = servo_model(motor.model)
    other = NodeParameters(node, SecondMotorParameters, f"{controller}.second_motor.").value
    second = (
        ServoCalibration(joint.joint_name, other.id, other.init, other.min, other.max, model)
        if other.id >= 0
        else None
    )
    made.append(
        JointConfiguration(
            joint.joint_name,
            controller,
            motor.id,
            motor.init,
            motor.min,
            motor.max,
            joint.joint_speed,
            joint.max_speed or None,
            model,
            second,
        )
    )
    return DeclaredJoint(made[0], joint.port_name, joint.baud_rate)


def _refuse_impossible(make: Callable[[], object]) -> None:
    try:
        make()
    except ConfigurationError as error:
        raise ParameterError(str(error)) from error
