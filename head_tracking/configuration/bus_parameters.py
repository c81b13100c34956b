"""The parameters of the servo bus and its joints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from head_tracking.dynamixel import (
    ConfigurationError,
    JointConfiguration,
    ServoCalibration,
    servo_model,
)
from head_tracking.parameters import parameter

_ANY_OFFSET: Final = -(2**31)
_OFFSET: Final = (
    "Offset in the servo's memory (Position, Homing or Multi Turn Offset) to which init, min and "
    "max belong; a servo with another offset is refused. The default: not checked."
)
_REVERSE: Final = (
    "Bit 0 (reverse) of Drive Mode to which min and max belong; a servo with another value is "
    "refused; -1: not checked."
)


@dataclass(frozen=True, slots=True)
class ServoBusParameters:
    """The port and its servos."""

    port_name: str = parameter("/dev/ttyUSB0", "Serial port of the bus.", fixed=True)
    baud_rate: int = parameter(
        1_000_000,
        "Baud rate of the bus.",
        unit="bit/s",
        minimum=9600,
        maximum=4_500_000,
        fixed=True,
    )
    update_rate: float = parameter(
        50.0, "Bus cycles per second.", unit="Hz", minimum=1.0, maximum=1000.0, fixed=True
    )
    diagnostics_rate: float = parameter(
        1.0, "Diagnostics per second.", unit="Hz", minimum=0.1, maximum=50.0, fixed=True
    )
    reply_timeout: float = parameter(
        0.0,
        "Timeout for a reply, in addition to its transmission time; 0: adapted to the measured "
        "reply times of the port.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        fixed=True,
    )
    allow_missing: bool = parameter(
        False, "Start although servos do not answer, and search for them.", fixed=True
    )
    short_names: bool = parameter(
        True,
        "Offer stop, resume, relax, recover and torque_enable also without the node's name.",
        fixed=True,
    )
    command_timeout: float = parameter(
        0.0,
        "A moving joint stops at its position this long after its last command; 0: never.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        fixed=True,
    )
    bus_watchdog: float = parameter(
        1.0,
        "Servos of the X series stop after this time without a packet; 0: never.",
        unit="s",
        minimum=0.0,
        maximum=2.5,
        fixed=True,
    )
    dynamixels: tuple[str, ...] = parameter(
        ("head_pan", "head_tilt"),
        "Names of the servos; the parameters X_controller.* describe X.",
        fixed=True,
        ros_name=True,
    )


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """A joint with one servo or two."""

    joint_name: str = parameter("", "The joint that the servo drives.", fixed=True)
    joint_speed: float = parameter(
        2.0,
        "Speed for commands without one; at most twice the no-load speed of the servo.",
        unit="rad/s",
        minimum=0.02,
    )
    max_speed: float = parameter(
        0.0,
        "Highest commanded speed; 0: the no-load speed of the servo.",
        unit="rad/s",
        minimum=0.0,
    )
    port_name: str = parameter(
        "", "Serial port of the servo; empty: port_name of the node.", fixed=True
    )
    baud_rate: int = parameter(
        0,
        "Baud rate of that port; 0: baud_rate of the node.",
        unit="bit/s",
        minimum=0,
        maximum=4_500_000,
        fixed=True,
    )


@dataclass(frozen=True, slots=True)
class SecondMotorParameters:
    """The second servo of a joint that two servos of one model drive."""

    id: int = parameter(
        -1, "Id of the servo on the bus; -1: none.", minimum=-1, maximum=253, fixed=True
    )
    init: int = parameter(512, "Tick at position 0.", unit="ticks", fixed=True)
    min: int = parameter(
        0, "Tick at the lower limit; above `max` if ticks fall.", unit="ticks", fixed=True
    )
    max: int = parameter(1023, "Tick at the upper limit.", unit="ticks", fixed=True)
    offset: int = parameter(_ANY_OFFSET, _OFFSET, unit="ticks", fixed=True)
    reverse: int = parameter(-1, _REVERSE, minimum=-1, maximum=1, fixed=True)


@dataclass(frozen=True, slots=True)
class MotorParameters(SecondMotorParameters):
    """The servo of a joint."""

    min: int = parameter(0, "Tick at the lower limit; above `max` if ticks fall.", unit="ticks")
    max: int = parameter(1023, "Tick at the upper limit.", unit="ticks")
    model: str = parameter("AX-12", "Model of the servo, such as XM430-W350.", fixed=True)


TUTORIAL_HEAD: Final[dict[str, dict[str, Any]]] = {
    "head_pan": {"id": 1},
    "head_tilt": {"id": 2, "min": 300, "max": 800},
}
"""Default motors: those of the tutorials' head."""


def configured_joint(
    dynamixel: str,
    controller: ControllerParameters,
    motor: MotorParameters,
    second_motor: SecondMotorParameters,
) -> JointConfiguration:
    """Return the joint of a servo in the list `dynamixels`.

    Raises:
        ConfigurationError: the servo does not support its configuration, or has no id.
    """
    if motor.id < 0:
        raise ConfigurationError(
            f"the servo {dynamixel!r} has no id; set the parameter {dynamixel}_controller.motor.id"
        )
    model = servo_model(motor.model)

    def calibration(servo: SecondMotorParameters) -> dict[str, Any]:
        return {
            "joint_name": controller.joint_name,
            "id": servo.id,
            "init": servo.init,
            "min": servo.min,
            "max": servo.max,
            "model": model,
            "offset": None if servo.offset == _ANY_OFFSET else servo.offset,
            "reverse": None if servo.reverse < 0 else bool(servo.reverse),
        }

    return JointConfiguration(
        **calibration(motor),
        controller=f"{dynamixel}_controller",
        joint_speed=controller.joint_speed,
        max_speed=controller.max_speed or None,
        second=ServoCalibration(**calibration(second_motor)) if second_motor.id >= 0 else None,
    )


def joints_by_port(
    bus: ServoBusParameters, joints: Iterable[tuple[ControllerParameters, JointConfiguration]]
) -> dict[str, tuple[int, list[JointConfiguration]]]:
    """Return baud rate and joints of each port.

    Raises:
        ConfigurationError: joints of one port have different baud rates, or there are none.
    """
    ports: dict[str, tuple[int, list[JointConfiguration]]] = {}
    for controller, joint in joints:
        name = controller.port_name or bus.port_name
        baud_rate = controller.baud_rate or bus.baud_rate
        common, found = ports.setdefault(name, (baud_rate, []))
        if baud_rate != common:
            raise ConfigurationError(
                f"{joint.joint_name}: its baud rate is {baud_rate}, that of others on {name} is "
                f"{common}; all servos of a port need the same"
            )
        found.append(joint)
    if not ports:
        raise ConfigurationError("dynamixels is empty; it needs the name of one servo at least")
    return ports
