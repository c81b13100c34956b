"""The parameters of the servo bus and its joints, by the tutorials' names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from head_tracking.dynamixel import (
    BusSettings,
    ConfigurationError,
    JointConfiguration,
    ServoCalibration,
    servo_model,
)
from head_tracking.parameters import parameter

_ANY_OFFSET: Final = -(2**31)
_OFFSET: Final = (
    "What the servo's memory added to its position (Position, Homing or Multi Turn Offset) when "
    "init, min and max were measured; a servo with another one is refused. The default: it is not "
    "checked."
)
_REVERSE: Final = (
    "Bit 0 (reverse) of Drive Mode that min and max belong to; a servo with another one is "
    "refused; -1: it is not checked."
)


@dataclass(frozen=True, slots=True)
class ServoBusParameters:
    """The port and who is on it."""

    port_name: str = parameter("/dev/ttyUSB0", "Serial port of the bus.", fixed=True)
    baud_rate: int = parameter(
        1_000_000, "Speed of the bus.", unit="bit/s", minimum=9600, maximum=4_500_000, fixed=True
    )
    update_rate: float = parameter(
        50.0, "Bus cycles per second.", unit="Hz", minimum=1.0, maximum=1000.0, fixed=True
    )
    diagnostics_rate: float = parameter(
        1.0, "Diagnostics per second.", unit="Hz", minimum=0.1, maximum=50.0, fixed=True
    )
    reply_timeout: float = parameter(
        0.0,
        "How long to wait for a servo's answer, besides its time on the wire; 0: as long as "
        "answers take on this port, and a margin.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        fixed=True,
    )
    allow_missing: bool = parameter(
        False, "Start without the servos that do not answer, and look for them.", fixed=True
    )
    short_names: bool = parameter(
        True,
        "Offer stop, resume, relax, recover and torque_enable also without the node's name before "
        "them.",
        fixed=True,
    )
    command_timeout: float = parameter(
        0.0,
        "A joint that is under way holds where it is this long after its last command; 0: never.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        fixed=True,
    )
    bus_watchdog: float = parameter(
        1.0,
        "Servos of the X series stop by themselves after this time without a packet; 0: never.",
        unit="s",
        minimum=0.0,
        maximum=2.5,
        fixed=True,
    )
    dynamixels: tuple[str, ...] = parameter(
        ("head_pan", "head_tilt"), "The servos; X is described by X_controller.*.", fixed=True
    )


@dataclass(frozen=True, slots=True)
class TemperatureParameters:
    """When a servo is too warm; the factory's own limit is 65 to 80 degrees."""

    warn: float = parameter(
        60.0, "Worth a warning.", unit="degrees Celsius", minimum=0.0, maximum=100.0, fixed=True
    )
    error: float = parameter(
        65.0, "Worth an error.", unit="degrees Celsius", minimum=0.0, maximum=100.0, fixed=True
    )
    rest: float = parameter(
        68.0,
        "The joint is relaxed, until it is below the warning.",
        unit="degrees Celsius",
        minimum=0.0,
        maximum=100.0,
        fixed=True,
    )


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """A joint that a servo turns."""

    joint_name: str = parameter("", "The joint that the servo turns.", fixed=True)
    joint_speed: float = parameter(
        2.0,
        "Speed for commands that give none; at most twice the no-load speed of the servo's model.",
        unit="rad/s",
        minimum=0.02,
    )
    max_speed: float = parameter(
        0.0,
        "Highest speed ever asked of the servo; 0 for the no-load speed of its model.",
        unit="rad/s",
        minimum=0.0,
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
    offset: int = parameter(_ANY_OFFSET, _OFFSET, unit="ticks", fixed=True)
    reverse: int = parameter(-1, _REVERSE, minimum=-1, maximum=1, fixed=True)


@dataclass(frozen=True, slots=True)
class SecondMotorParameters:
    """The other servo of a joint that two of them drive, of the same model."""

    id: int = parameter(
        -1, "Id of the second servo; -1: none.", minimum=-1, maximum=253, fixed=True
    )
    init: int = parameter(512, "Where the joint is at 0.", unit="ticks", fixed=True)
    min: int = parameter(0, "The joint's lower limit.", unit="ticks", fixed=True)
    max: int = parameter(1023, "The joint's upper limit.", unit="ticks", fixed=True)
    offset: int = parameter(_ANY_OFFSET, _OFFSET, unit="ticks", fixed=True)
    reverse: int = parameter(-1, _REVERSE, minimum=-1, maximum=1, fixed=True)


TUTORIAL_HEAD: Final[dict[str, dict[str, Any]]] = {
    "head_pan": {"id": 1},
    "head_tilt": {"id": 2, "min": 300, "max": 800},
}
"""What the motors of the tutorials' head are where nobody says otherwise."""


def bus_settings(p: ServoBusParameters, temperature: TemperatureParameters) -> BusSettings:
    """How the bus deals with silence, faults and heat.

    Raises:
        ConfigurationError: the temperatures do not rise.
    """
    return BusSettings(
        command_timeout=p.command_timeout,
        watchdog=p.bus_watchdog,
        warm=temperature.warn,
        hot=temperature.error,
        rest=temperature.rest,
    )


def configured_joint(
    dynamixel: str,
    controller: ControllerParameters,
    motor: MotorParameters,
    second_motor: SecondMotorParameters,
) -> JointConfiguration:
    """The joint that a servo, named as in the list `dynamixels`, turns.

    Raises:
        ConfigurationError: the servo can't do what is configured, or has no id.
    """
    if motor.id < 0:
        raise ConfigurationError(
            f"the servo {dynamixel!r} has no id; set the parameter {dynamixel}_controller.motor.id"
        )
    model, name = servo_model(motor.model), controller.joint_name
    second = None
    if second_motor.id >= 0:
        second = ServoCalibration(
            name,
            second_motor.id,
            second_motor.init,
            second_motor.min,
            second_motor.max,
            model,
            offset=_offset(second_motor),
            reverse=_reverse(second_motor),
        )
    return JointConfiguration(
        name,
        motor.id,
        motor.init,
        motor.min,
        motor.max,
        controller=f"{dynamixel}_controller",
        joint_speed=controller.joint_speed,
        max_speed=controller.max_speed or None,
        model=model,
        second=second,
        offset=_offset(motor),
        reverse=_reverse(motor),
    )


def _offset(motor: MotorParameters | SecondMotorParameters) -> int | None:
    return None if motor.offset == _ANY_OFFSET else motor.offset


def _reverse(motor: MotorParameters | SecondMotorParameters) -> bool | None:
    return None if motor.reverse < 0 else bool(motor.reverse)
