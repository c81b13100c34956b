"""Servo models, as data. A new model is a control table and one `ServoModel`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.dynamixel.control_table import AX_12 as AX_12_TABLE
from head_tracking.dynamixel.control_table import Block, ControlTable
from head_tracking.dynamixel.conversions import RPM
from head_tracking.dynamixel.exceptions import ConfigurationError


@dataclass(frozen=True, slots=True)
class ServoModel:
    """What the driver and the simulator must know about a model.

    Attributes:
        name: The name used in configurations and messages.
        model_number: Contents of its Model Number register.
        protocol: Dynamixel protocol, 1 or 2.
        control_table: Its registers.
        feedback: What one read fetches each cycle: position, speed, load, voltage, temperature.
        goal: What one write sets: goal position and moving speed.
        ticks: Number of positions.
        angle_range: Angle that the ticks span, rad.
        center: The tick in the middle of the range.
        speed_unit: One count of speed, rad/s.
        speed_maximum: Highest Moving Speed in joint mode.
        load_maximum: Register value of full load.
        no_load_speed: Fastest speed without load at `nominal_voltage`, rad/s.
        stall_torque: Torque at standstill at `nominal_voltage`, N m.
        nominal_voltage: Supply for which the two values above hold, V.
        aliases: Other names of the same model.
    """

    name: str
    model_number: int
    protocol: int
    control_table: ControlTable
    feedback: Block
    goal: Block
    ticks: int
    angle_range: float
    center: int
    speed_unit: float
    speed_maximum: int
    load_maximum: int
    no_load_speed: float
    stall_torque: float
    nominal_voltage: float
    aliases: tuple[str, ...] = ()

    @property
    def radians_per_tick(self) -> float:
        """Angle of one tick, rad."""
        return self.angle_range / self.ticks


AX_12 = ServoModel(
    name="AX-12",
    model_number=12,
    protocol=1,
    control_table=AX_12_TABLE,
    feedback=AX_12_TABLE.block(
        "Present Position",
        "Present Speed",
        "Present Load",
        "Present Voltage",
        "Present Temperature",
    ),
    goal=AX_12_TABLE.block("Goal Position", "Moving Speed"),
    ticks=1024,
    angle_range=math.radians(300.0),
    center=512,
    speed_unit=0.111 * RPM,
    speed_maximum=1023,
    load_maximum=1023,
    no_load_speed=59.0 * RPM,
    stall_torque=1.5,
    nominal_voltage=12.0,
    aliases=("AX-12A", "AX-12+"),
)
"""ROBOTIS e-manual page AX-12A. One tick is 300/1024 degrees, as in dynamixel_motor."""

MODELS: tuple[ServoModel, ...] = (AX_12,)

_BY_NAME = {name.upper(): model for model in MODELS for name in (model.name, *model.aliases)}
_BY_NUMBER = {model.model_number: model for model in MODELS}


def servo_model(name: str) -> ServoModel:
    """Return the model of that name (or alias), in capitals or not.

    Raises:
        ConfigurationError: No such model is known.
    """
    model = _BY_NAME.get(name.upper())
    if model is None:
        raise ConfigurationError(f"unknown servo model {name!r}; known are {_known()}")
    return model


def servo_model_by_number(model_number: int) -> ServoModel:
    """Return the model whose Model Number register holds `model_number`.

    Raises:
        ConfigurationError: No such model is known.
    """
    model = _BY_NUMBER.get(model_number)
    if model is None:
        raise ConfigurationError(f"unknown servo model number {model_number}; known are {_known()}")
    return model


def _known() -> str:
    return ", ".join(f"{model.name} ({model.model_number})" for model in MODELS)
