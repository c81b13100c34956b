"""Servo models, as data. A new model is a control table and one entry here.

Speeds and torques are those of the e-manual pages, at the voltage in bold there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntFlag
from types import MappingProxyType
from typing import Final

from head_tracking.dynamixel import tables
from head_tracking.dynamixel.control_table import (
    AX_ANGLE,
    AX_SPEED,
    AX_TICKS,
    MX_12W_SPEED,
    MX_ANGLE,
    MX_SPEED,
    MX_TICKS,
    RPM,
    X_SPEED,
    Block,
    ControlTable,
)
from head_tracking.dynamixel.exceptions import ConfigurationError
from head_tracking.dynamixel.protocol import ErrorBits, HardwareErrors, XL320Errors


@dataclass(frozen=True, slots=True)
class ServoModel:
    """What the driver and the simulator must know about a model.

    Attributes:
        name: The name used in configurations and messages.
        model_number: Contents of its Model Number register.
        protocol: Dynamixel protocol, 1 or 2.
        control_table: Its registers.
        feedback: What one read fetches each cycle: position, speed, load, voltage, temperature.
        feedback_order: Where in that block the five of them stand.
        goal: What one write sets: goal position and speed.
        position_first: Whether the goal position comes first in that block.
        position_limits: Names of the registers with the lowest and highest goal position.
        ticks: Number of positions.
        angle_range: Angle that the ticks span, rad.
        center: The tick in the middle of the range.
        speed_unit: One count of speed, rad/s.
        speed_maximum: Highest goal speed in joint mode.
        load_maximum: Register value of full load (of the stall current, where current is told).
        no_load_speed: Fastest speed without load at `nominal_voltage`, rad/s.
        stall_torque: Torque at standstill at `nominal_voltage`, N m.
        nominal_voltage: Supply for which the two values above hold, V.
        baud_rates: Bits per second by the value of the Baud Rate register.
        errors: Bits of its error state and of its Shutdown register.
        bulk_read: Whether it takes part in a bulk read (MX with protocol 1.0).
        fast_sync_read: First firmware that knows fast sync read; None: none does.
        watchdog: First firmware that has a Bus Watchdog; None: none has.
        aliases: Other names of the same model.
        radians_per_tick: Angle of one tick, rad.
        sign_magnitude: Whether speed and load have their sign in bit 10.
        endless: Whether the ticks go round a whole turn, so that each stands for many positions.
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
    baud_rates: Mapping[int, int]
    errors: type[IntFlag]
    feedback_order: tuple[int, int, int, int, int] = (0, 1, 2, 3, 4)
    position_first: bool = True
    position_limits: tuple[str, str] = ("CW Angle Limit", "CCW Angle Limit")
    bulk_read: bool = False
    fast_sync_read: int | None = None
    watchdog: int | None = None
    aliases: tuple[str, ...] = ()
    radians_per_tick: float = field(init=False)
    sign_magnitude: bool = field(init=False)
    endless: bool = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radians_per_tick", self.angle_range / self.ticks)
        object.__setattr__(self, "sign_magnitude", "Moving Speed" in self.control_table)
        object.__setattr__(self, "endless", self.ticks == MX_TICKS)

    def encode_goal(self, ticks: int, speed: int) -> bytes:
        """Return what to write at `goal`, from register values.

        Raises:
            RangeError: A value is outside its register.
        """
        return self.goal.encode(*((ticks, speed) if self.position_first else (speed, ticks)))


def _ax_rates(highest: Mapping[int, int]) -> Mapping[int, int]:
    usual = {1: 1_000_000, 3: 500_000, 4: 400_000, 7: 250_000, 9: 200_000}
    slow = {16: 115_200, 34: 57_600, 103: 19_200, 207: 9_600}
    return MappingProxyType(usual | slow | dict(highest))


AX_BAUD_RATES: Final = _ax_rates({})
MX_BAUD_RATES: Final = _ax_rates({250: 2_250_000, 251: 2_500_000, 252: 3_000_000})
XL320_BAUD_RATES: Final = MappingProxyType({0: 9_600, 1: 57_600, 2: 115_200, 3: 1_000_000})
X330_BAUD_RATES: Final = MappingProxyType(
    {**XL320_BAUD_RATES, 4: 2_000_000, 5: 3_000_000, 6: 4_000_000}
)
X_BAUD_RATES: Final = MappingProxyType({**X330_BAUD_RATES, 7: 4_500_000})

_X_ORDER = (2, 1, 0, 3, 4)
_FIRST_WATCHDOG: Final = 38  # firmware


def _joint_mode(
    table: ControlTable,
    rpm: float,
    stall_torque: float,
    volts: float,
    *aliases: str,
    speed_unit: float | None = None,
    baud_rates: Mapping[int, int] | None = None,
    errors: type[IntFlag] = ErrorBits,
) -> ServoModel:
    """Return a model with a moving speed: AX, RX, MX with protocol 1.0, and XL-320.

    Args:
        table: Its control table.
        rpm: No-load speed, revolutions per minute.
        stall_torque: N m.
        volts: Supply at which it reaches both.
        aliases: Other names of it.
        speed_unit: One count of speed, rad/s; None: that of its series.
        baud_rates: By the value of Baud Rate; None: those of its series.
        errors: Bits of its error state.
    """
    number = table["Model Number"].initial
    assert number is not None
    mx = table.name.startswith("MX")
    return ServoModel(
        name=table.name,
        model_number=number,
        protocol=2 if errors is XL320Errors else 1,
        control_table=table,
        feedback=table.block(
            "Present Position",
            "Present Speed",
            "Present Load",
            "Present Voltage",
            "Present Temperature",
        ),
        goal=table.block("Goal Position", "Moving Speed"),
        ticks=MX_TICKS if mx else AX_TICKS,
        angle_range=MX_ANGLE if mx else AX_ANGLE,
        center=2048 if mx else 512,
        speed_unit=speed_unit or (MX_SPEED if mx else AX_SPEED),
        speed_maximum=1023,
        load_maximum=1023,
        no_load_speed=rpm * RPM,
        stall_torque=stall_torque,
        nominal_voltage=volts,
        baud_rates=baud_rates or (MX_BAUD_RATES if mx else AX_BAUD_RATES),
        errors=errors,
        bulk_read=mx,
        aliases=aliases,
    )


def _x(
    table: ControlTable,
    rpm: float,
    stall_torque: float,
    volts: float,
    *,
    stall_current: float | None = None,
    fast_sync_read: int | None = None,
) -> ServoModel:
    """Return a model of the X series or an MX(2.0), from its table and its performance.

    Args:
        table: Its control table.
        rpm: No-load speed, revolutions per minute.
        stall_torque: N m.
        volts: Supply at which it reaches both.
        stall_current: mA; None for models that tell their load.
        fast_sync_read: First firmware that knows fast sync read.
    """
    number = table["Model Number"].initial
    assert number is not None
    small = table["Baud Rate"].maximum == 6
    if stall_current is None:
        effort, full = "Present Load", 1000
    else:
        effort = "Present Current"
        full = round(stall_current / table[effort].unit.scale)
    return ServoModel(
        name=table.name,
        model_number=number,
        protocol=2,
        control_table=table,
        feedback=table.block(
            effort,
            "Present Velocity",
            "Present Position",
            "Present Input Voltage",
            "Present Temperature",
        ),
        feedback_order=_X_ORDER,
        goal=table.block("Profile Velocity", "Goal Position"),
        position_first=False,
        position_limits=("Min Position Limit", "Max Position Limit"),
        ticks=MX_TICKS,
        angle_range=MX_ANGLE,
        center=2048,
        speed_unit=X_SPEED,
        speed_maximum=32767,
        load_maximum=full,
        no_load_speed=rpm * RPM,
        stall_torque=stall_torque,
        nominal_voltage=volts,
        baud_rates=X330_BAUD_RATES if small else X_BAUD_RATES,
        errors=HardwareErrors,
        fast_sync_read=fast_sync_read,
        watchdog=_FIRST_WATCHDOG,
    )


AX_12 = _joint_mode(tables.AX_12, 59.0, 1.5, 12.0, "AX-12A", "AX-12+")

MODELS: Final[tuple[ServoModel, ...]] = (
    AX_12,
    _joint_mode(tables.AX_12W, 54.0, 0.2, 12.0),  # its speed in joint mode
    _joint_mode(tables.AX_18, 97.0, 1.8, 12.0, "AX-18"),
    _joint_mode(tables.RX_10, 54.0, 1.3, 12.0),
    _joint_mode(tables.RX_24F, 126.0, 2.6, 12.0),
    _joint_mode(tables.RX_28, 85.0, 3.7, 18.5),
    _joint_mode(tables.RX_64, 64.0, 5.3, 18.5),
    _joint_mode(tables.MX_12W, 470.0, 0.2, 12.0, speed_unit=MX_12W_SPEED),
    _joint_mode(tables.MX_28, 55.0, 2.5, 12.0, "MX-28T", "MX-28R"),
    _joint_mode(tables.MX_64, 63.0, 6.0, 12.0, "MX-64T", "MX-64R"),
    _joint_mode(tables.MX_106, 45.0, 8.4, 12.0, "MX-106T", "MX-106R"),
    _x(tables.MX_28_2, 55.0, 2.5, 12.0),
    _x(tables.MX_64_2, 63.0, 6.0, 12.0, stall_current=4100.0),
    _x(tables.MX_106_2, 45.0, 8.4, 12.0, stall_current=5200.0),
    _joint_mode(
        tables.XL_320, 114.0, 0.39, 7.4, "XL320", baud_rates=XL320_BAUD_RATES, errors=XL320Errors
    ),
    _x(tables.XL430_W250, 57.0, 1.4, 11.1, fast_sync_read=45),
    _x(tables.XL330_M077, 383.0, 0.215, 5.0, stall_current=1470.0, fast_sync_read=46),
    _x(tables.XL330_M288, 103.0, 0.52, 5.0, stall_current=1470.0, fast_sync_read=46),
    _x(tables.XC330_M181, 129.0, 0.60, 5.0, stall_current=1800.0, fast_sync_read=46),
    _x(tables.XC330_M288, 81.0, 0.93, 5.0, stall_current=1800.0, fast_sync_read=46),
    _x(tables.XC330_T181, 104.0, 0.76, 11.1, stall_current=800.0, fast_sync_read=46),
    _x(tables.XC330_T288, 65.0, 0.92, 11.1, stall_current=800.0, fast_sync_read=46),
    _x(tables.XM430_W210, 77.0, 3.0, 12.0, stall_current=2300.0, fast_sync_read=45),
    _x(tables.XM430_W350, 46.0, 4.1, 12.0, stall_current=2300.0, fast_sync_read=45),
    _x(tables.XM540_W150, 53.0, 7.3, 12.0, stall_current=4400.0, fast_sync_read=45),
    _x(tables.XM540_W270, 30.0, 10.6, 12.0, stall_current=4400.0, fast_sync_read=45),
    _x(tables.XC430_W150, 106.0, 1.6, 12.0, fast_sync_read=45),
    _x(tables.XL430_W250_2, 57.0, 1.4, 11.1),
    _x(tables.XH430_W350, 30.0, 3.4, 12.0, stall_current=1300.0, fast_sync_read=45),
    _x(tables.XH540_V150, 60.0, 6.4, 24.0, stall_current=2400.0, fast_sync_read=45),
    _x(tables.XW540_T140, 72.0, 6.9, 12.0, stall_current=4900.0),
)

_BY_NAME = {name.upper(): model for model in MODELS for name in (model.name, *model.aliases)}
_BY_NUMBER = {model.model_number: model for model in MODELS}


def servo_model(name: str) -> ServoModel:
    """Return the model of that name or alias, in capitals or not.

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
