"""The configuration of servos and joints as ROS parameters, with the tutorials' names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from rclpy.node import Node

from head_tracking.configuration.bus_parameters import (
    TUTORIAL_HEAD,
    ControllerParameters,
    MotorParameters,
    SecondMotorParameters,
    configured_joint,
)
from head_tracking.dynamixel import (
    ConfigurationError,
    JointConfiguration,
    fastest_speed,
    servo_model,
)
from head_tracking.parameters import ParameterError
from head_tracking.ros.kit.node_parameters import NodeParameters


class DeclaredJoint(NamedTuple):
    """A joint and its bus.

    Attributes:
        configuration: of the joint.
        port_name: serial port; empty: that of the node.
        baud_rate: of that port [bit/s]; 0: that of the node.
    """

    configuration: JointConfiguration
    port_name: str
    baud_rate: int


OnController = Callable[[str, ControllerParameters], None]
OnMotor = Callable[[str, MotorParameters], None]


def declare_joint(
    node: Node,
    dynamixel: str,
    on_controller: OnController,
    on_motor: OnMotor,
    check_motor: OnMotor,
) -> DeclaredJoint:
    """Declare the parameters `<dynamixel>_controller.*` and return their values.

    Args:
        node: declares the parameters.
        dynamixel: the servo's name in the list `dynamixels`.
        on_controller: called with the joint and its parameters after a speed was changed.
        on_motor: called with the joint and its parameters after a limit was changed.
        check_motor: called before that; raises ConfigurationError if the limit cannot be set.

    Raises:
        ConfigurationError: the configuration is not possible for the servo, or has no id.
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

    motor = NodeParameters(
        node,
        MotorParameters,
        f"{controller}.motor.",
        TUTORIAL_HEAD.get(dynamixel),
        lambda changed: on_motor(joint.joint_name, changed),
        check_limits,
    ).value
    fastest = fastest_speed(servo_model(motor.model))
    joint = NodeParameters(
        node,
        ControllerParameters,
        f"{controller}.",
        {"joint_name": joint_name},
        lambda changed: on_controller(changed.joint_name, changed),
        check_speeds,
        {"joint_speed": fastest, "max_speed": fastest},
    ).value
    other = NodeParameters(node, SecondMotorParameters, f"{controller}.second_motor.").value
    made.append(configured_joint(dynamixel, joint, motor, other))
    return DeclaredJoint(made[0], joint.port_name, joint.baud_rate)


def _refuse_impossible(make: Callable[[], object]) -> None:
    try:
        make()
    except ConfigurationError as error:
        raise ParameterError(str(error)) from error
