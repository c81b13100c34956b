"""X series and MX(2.0): ROBOTIS e-manual pages of each model.

Their layouts differ in what they have, not in where it is: a table is made of what they share, of
the values that differ, and of the registers that only some have.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from head_tracking.dynamixel.control_table import ControlTable, Register, Unit
from head_tracking.dynamixel.tables.row import SIGNED, eeprom, fixed, measured, ram
from head_tracking.dynamixel.units import (
    CELSIUS,
    DELAY,
    MILLISECOND,
    MX_OFFSET,
    MX_POSITION,
    PER_MILLE,
    PWM,
    VOLT,
    WATCHDOG,
    X_RAMP,
    X_VELOCITY,
    milliampere,
)

_TURNS = 1_048_575  # ticks either way in extended position mode
_OFFSET = 1_044_479


@dataclass(frozen=True, slots=True)
class Gains:
    """Initial gains: I and P of velocity, D, I and P of position."""

    velocity_i: int
    velocity_p: int
    position_d: int
    position_i: int
    position_p: int


@dataclass(frozen=True, slots=True)
class Supply:
    """Voltage limits in 0.1 V: the initial ones, and the range they may be set to."""

    highest: int
    lowest: int
    minimum: int
    maximum: int


FIVE_VOLTS = Supply(70, 35, 31, 70)
TWELVE_VOLTS = Supply(160, 95, 95, 160)
WIDE = Supply(140, 60, 60, 140)
WIDE_330 = Supply(140, 55, 55, 140)


def x_table(
    name: str,
    number: int,
    *,
    temperature_limit: int,
    supply: Supply,
    velocity_limit: int,
    gains: Gains,
    current: tuple[Unit, int] | None,
    extra: tuple[Register, ...],
    small: bool = False,
    shutdown: int = 52,
) -> ControlTable:
    """Return the table of a model.

    Args:
        name: The model, for messages.
        number: Its Model Number.
        temperature_limit: Initial limit, degrees Celsius.
        supply: Voltage limits.
        velocity_limit: Initial limit.
        gains: Initial gains.
        current: Unit and highest value of the current registers; None: it tells its load instead.
        extra: Registers that not all models have.
        small: Whether it is of the 330 series, which has fewer indirect registers.
        shutdown: Initial mask.
    """
    fastest = 2047 if small else 1023
    return ControlTable(
        name,
        (
            fixed("Model Number", 0, 2, number),
            fixed("Model Information", 2, 4),
            fixed("Firmware Version", 6, 1),
            eeprom("ID", 7, 1, 1, 0, 252),
            eeprom("Baud Rate", 8, 1, 1, 0, 6 if small else 7),
            eeprom("Return Delay Time", 9, 1, 250, 0, 254, DELAY),
            eeprom("Drive Mode", 10, 1, 0, 0, 13),
            eeprom("Operating Mode", 11, 1, 3, 0, 16),
            eeprom("Secondary ID", 12, 1, 255, 0, 255),
            eeprom("Protocol Type", 13, 1, 2, 2 if small else 1, 22 if small else 2),
            eeprom("Homing Offset", 20, 4, 0, -_OFFSET, _OFFSET, MX_OFFSET, SIGNED),
            eeprom("Moving Threshold", 24, 4, 10, 0, 1023, X_VELOCITY),
            eeprom("Temperature Limit", 31, 1, temperature_limit, 0, 100, CELSIUS),
            eeprom(
                "Max Voltage Limit", 32, 2, supply.highest, supply.minimum, supply.maximum, VOLT
            ),
            eeprom("Min Voltage Limit", 34, 2, supply.lowest, supply.minimum, supply.maximum, VOLT),
            eeprom("PWM Limit", 36, 2, 885, 0, 885, PWM),
            eeprom("Velocity Limit", 44, 4, velocity_limit, 0, fastest, X_VELOCITY),
            eeprom("Max Position Limit", 48, 4, 4095, 0, 4095, MX_POSITION),
            eeprom("Min Position Limit", 52, 4, 0, 0, 4095, MX_POSITION),
            eeprom("Shutdown", 63, 1, shutdown, 0, 63),
            ram("Torque Enable", 64, 1, 0, 0, 1),
            ram("LED", 65, 1, 0, 0, 1),
            ram("Status Return Level", 68, 1, 2, 0, 2),
            measured("Registered Instruction", 69, 1, initial=0),
            measured("Hardware Error Status", 70, 1, initial=0),
            ram("Velocity I Gain", 76, 2, gains.velocity_i, 0, 16383),
            ram("Velocity P Gain", 78, 2, gains.velocity_p, 0, 16383),
            ram("Position D Gain", 80, 2, gains.position_d, 0, 16383),
            ram("Position I Gain", 82, 2, gains.position_i, 0, 16383),
            ram("Position P Gain", 84, 2, gains.position_p, 0, 16383),
            ram("Feedforward 2nd Gain", 88, 2, 0, 0, 16383),
            ram("Feedforward 1st Gain", 90, 2, 0, 0, 16383),
            ram("Bus Watchdog", 98, 1, 0, 0, 127, WATCHDOG),
            ram("Goal PWM", 100, 2, 885, -885, 885, PWM, SIGNED),
            ram("Goal Velocity", 104, 4, velocity_limit, -fastest, fastest, X_VELOCITY, SIGNED),
            ram("Profile Acceleration", 108, 4, 0, 0, 32767, X_RAMP),
            ram("Profile Velocity", 112, 4, 0, 0, 32767, X_VELOCITY),
            ram("Goal Position", 116, 4, None, -_TURNS, _TURNS, MX_POSITION, SIGNED),
            measured("Realtime Tick", 120, 2, MILLISECOND),
            measured("Moving", 122, 1, initial=0),
            measured("Moving Status", 123, 1, initial=0),
            measured("Present PWM", 124, 2, PWM, SIGNED),
            measured("Present Velocity", 128, 4, X_VELOCITY, SIGNED),
            measured("Present Position", 132, 4, MX_POSITION, SIGNED),
            measured("Velocity Trajectory", 136, 4, X_VELOCITY, SIGNED),
            measured("Position Trajectory", 140, 4, MX_POSITION, SIGNED),
            measured("Present Input Voltage", 144, 2, VOLT),
            measured("Present Temperature", 146, 1, CELSIUS),
            *_effort(current),
            *(_indirect(1, 20, 168, 208, 227) if small else _indirect(1, 28, 168, 224, 661)),
            *(() if small else _indirect(29, 56, 578, 634, 661)),
            *extra,
        ),
    )


def _effort(current: tuple[Unit, int] | None) -> tuple[Register, ...]:
    if current is None:
        return (measured("Present Load", 126, 2, PER_MILLE, SIGNED),)
    unit, limit = current
    return (
        eeprom("Current Limit", 38, 2, limit, 0, limit, unit),
        ram("Goal Current", 102, 2, limit, -limit, limit, unit, SIGNED),
        measured("Present Current", 126, 2, unit, SIGNED),
    )


def _indirect(first: int, last: int, addresses: int, data: int, highest: int) -> Iterator[Register]:
    for number in range(first, last + 1):
        index = number - first
        target = data + index
        yield ram(f"Indirect Address {number}", addresses + 2 * index, 2, target, 64, highest)
        yield ram(f"Indirect Data {number}", target, 1, 0, 0, 255)


STARTUP = eeprom("Startup Configuration", 60, 1, 0, 0, 3)
BACKUP = measured("Backup Ready", 147, 1, initial=0)
ACCELERATION_LIMIT = eeprom("Acceleration Limit", 40, 4, 32767, 0, 32767, X_RAMP)
PWM_SLOPE_5V = eeprom("PWM Slope", 62, 1, 140, 1, 255, Unit("mV/ms", 1.977))
PWM_SLOPE_12V = eeprom("PWM Slope", 62, 1, 255, 1, 255, Unit("mV/ms", 3.955))
EXTERNAL_PORTS = tuple(
    register
    for number in (1, 2, 3)
    for register in (
        eeprom(f"External Port Mode {number}", 55 + number, 1, 3, 0, 3),
        ram(f"External Port Data {number}", 150 + 2 * number, 2, 0, 0, 4095),
    )
)

_MX_2_GAINS = Gains(1920, 100, 0, 0, 850)
_XM_GAINS = Gains(1920, 100, 0, 0, 800)
_COMMON = (STARTUP, BACKUP)
_XM_CURRENT = milliampere(2.69)
_MX_CURRENT = milliampere(3.36)
_SMALL_CURRENT = milliampere(1.0)

MX_28_2 = x_table(
    "MX-28(2.0)", 30, temperature_limit=80, supply=TWELVE_VOLTS, velocity_limit=230,
    gains=_MX_2_GAINS, current=None, extra=(ACCELERATION_LIMIT, BACKUP),
)  # fmt: skip
MX_64_2 = x_table(
    "MX-64(2.0)", 311, temperature_limit=80, supply=TWELVE_VOLTS, velocity_limit=435,
    gains=_MX_2_GAINS, current=(_MX_CURRENT, 1941), extra=(ACCELERATION_LIMIT, BACKUP),
)  # fmt: skip
MX_106_2 = x_table(
    "MX-106(2.0)", 321, temperature_limit=80, supply=TWELVE_VOLTS, velocity_limit=360,
    gains=_MX_2_GAINS, current=(_MX_CURRENT, 2047), extra=(ACCELERATION_LIMIT, BACKUP),
)  # fmt: skip
XL430_W250 = x_table(
    "XL430-W250", 1060, temperature_limit=72, supply=WIDE, velocity_limit=265,
    gains=Gains(1000, 100, 4000, 0, 640), current=None, extra=_COMMON,
)  # fmt: skip
XM430_W210 = x_table(
    "XM430-W210", 1030, temperature_limit=80, supply=TWELVE_VOLTS, velocity_limit=330,
    gains=_XM_GAINS, current=(_XM_CURRENT, 1193), extra=_COMMON,
)  # fmt: skip
XM430_W350 = x_table(
    "XM430-W350", 1020, temperature_limit=80, supply=TWELVE_VOLTS, velocity_limit=200,
    gains=_XM_GAINS, current=(_XM_CURRENT, 1193), extra=_COMMON,
)  # fmt: skip
XM540_W150 = x_table(
    "XM540-W150", 1130, temperature_limit=80, supply=TWELVE_VOLTS, velocity_limit=230,
    gains=_XM_GAINS, current=(_XM_CURRENT, 2047), extra=(*_COMMON, *EXTERNAL_PORTS),
)  # fmt: skip
XM540_W270 = x_table(
    "XM540-W270", 1120, temperature_limit=80, supply=TWELVE_VOLTS, velocity_limit=128,
    gains=_XM_GAINS, current=(_XM_CURRENT, 2047), extra=(*_COMMON, *EXTERNAL_PORTS),
)  # fmt: skip
XL330_M077 = x_table(
    "XL330-M077", 1190, temperature_limit=70, supply=FIVE_VOLTS, velocity_limit=1620,
    gains=Gains(400, 40, 0, 400, 400), current=(_SMALL_CURRENT, 1750),
    extra=(*_COMMON, PWM_SLOPE_5V), small=True, shutdown=53,
)  # fmt: skip
XL330_M288 = x_table(
    "XL330-M288", 1200, temperature_limit=70, supply=FIVE_VOLTS, velocity_limit=445,
    gains=Gains(1600, 180, 0, 0, 400), current=(_SMALL_CURRENT, 1750),
    extra=(*_COMMON, PWM_SLOPE_5V), small=True, shutdown=53,
)  # fmt: skip
XC330_M181 = x_table(
    "XC330-M181", 1230, temperature_limit=70, supply=FIVE_VOLTS, velocity_limit=545,
    gains=Gains(1400, 100, 500, 0, 1200), current=(_SMALL_CURRENT, 2352),
    extra=(*_COMMON, PWM_SLOPE_5V), small=True,
)  # fmt: skip
XC330_M288 = x_table(
    "XC330-M288", 1240, temperature_limit=70, supply=FIVE_VOLTS, velocity_limit=350,
    gains=Gains(1600, 50, 500, 0, 1100), current=(_SMALL_CURRENT, 2352),
    extra=(*_COMMON, PWM_SLOPE_5V), small=True,
)  # fmt: skip
XC330_T181 = x_table(
    "XC330-T181", 1210, temperature_limit=70, supply=WIDE_330, velocity_limit=510,
    gains=Gains(1200, 40, 0, 0, 900), current=(_SMALL_CURRENT, 910),
    extra=(*_COMMON, PWM_SLOPE_12V), small=True,
)  # fmt: skip
XC330_T288 = x_table(
    "XC330-T288", 1220, temperature_limit=70, supply=WIDE_330, velocity_limit=320,
    gains=Gains(1200, 40, 0, 0, 900), current=(_SMALL_CURRENT, 910),
    extra=(*_COMMON, PWM_SLOPE_12V), small=True,
)  # fmt: skip
