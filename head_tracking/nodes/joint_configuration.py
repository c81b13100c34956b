"""The configuration of servos and joints as ROS parameters, by the tutorials' names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from head_tracking.dynamixel import ConfigurationError, JointConfiguration
from head_tracking.nodes.parameters import NodeParameters
from head_tracking.parameters import parameter


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """A joint that a servo turns."""

    joint_name: str = parameter("", "The joint that the servo turns.", fixed=True)
    joint_speed: float = parameter(
        2.0, "Speed for commands that give none.", unit="rad/s", minimum=0.02, maximum=12.0
    )


@dataclass(frozen=True, slots=True)
class MotorParameters:
    """The servo of a joint; `min` above `max` says that it is mounted the other way round."""

    id: int = parameter(-1, "Id of the servo on the bus.", minimum=-1, maximum=253, fixed=True)
    init: int = parameter(512, "Where the joint is at 0.", unit="ticks", fixed=True)
    min: int = parameter(0, "The joint's lower limit.", unit="ticks", fixed=True)
    max: int = parameter(1023, "The joint's upper limit.", unit="ticks", fixed=True)


_TUTORIAL_HEAD: dict[str, dict[str, Any]] = {
    "head_pan": {"id": 1},
    "head_tilt": {"id": 2, "min": 300, "max": 800},
}


def declare_joint(
    node: Node, dynamixel: str, on_speed: Callable[[str, float], None]
) -> JointConfiguration:
    """Declares the parameters `<dynamixel>_controller.*` and reads them.

    Args:
        node: declares the parameters.
        dynamixel: the servo's name in the list `dynamixels`.
        on_speed: called with joint and speed [rad/s] when somebody changes `joint_speed`.

    Raises:
        ConfigurationError: the servo can't do what is configured, or has no id.
        ValueError: a parameter is out of range.
    """
    controller = f"{dynamixel}_controller"
    joint = NodeParameters(
        node,
        ControllerParameters,
        f"{controller}.",
        {"joint_name": f"{dynamixel}_joint"},
        lambda changed: on_speed(changed.joint_name, changed.joint_speed),
    ).value
    motor = NodeParameters(
        node, MotorParameters, f"{controller}.motor.", _TUTORIAL_HEAD.get(dynamixel)
    ).value
    if motor.id < 0:
        raise ConfigurationError(
            f"the servo {dynamixel!r} has no id; set the parameter {controller}.motor.id"
        )
    return JointConfiguration(
        joint.joint_name,
        controller,
        motor.id,
        motor.init,
        motor.min,
        motor.max,
        joint.joint_speed,
    )
