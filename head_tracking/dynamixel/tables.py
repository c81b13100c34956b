"""The control tables of all models, from the ROBOTIS e-manual page of each.

Where a page gives no range, the range is that of the AX servos, whose layout AX, RX and MX share;
the AX ranges are also from the AX-12 manual of 2006.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from head_tracking.dynamixel.control_table import (
    AX_OFFSET,
    AX_POSITION,
    AX_VELOCITY,
    CELSIUS,
    DELAY,
    MILLISECOND,
    MX_12W_VELOCITY,
    MX_OFFSET,
    MX_POSITION,
    MX_RAMP,
    MX_VELOCITY,
    NUMBER,
    PER_MILLE,
    PWM,
    VOLT,
    WATCHDOG,
    X_RAMP,
    X_VELOCITY,
    Access,
    ControlTable,
    Memory,
    Register,
    Sign,
    Unit,
    milliampere,
)

MAGNITUDE = Sign.MAGNITUDE
SIGNED = Sign.TWOS_COMPLEMENT


def eeprom(
    name: str,
    address: int,
    size: int,
    initial: int | None,
    minimum: int,
    maximum: int,
    unit: Unit = NUMBER,
    sign: Sign = Sign.NONE,
) -> Register:
    """Return a setting that survives power-off."""
    return Register(
        name, address, size, Access.READ_WRITE, Memory.EEPROM, initial, minimum, maximum, unit, sign
    )


def ram(
    name: str,
    address: int,
    size: int,
    initial: int | None,
    minimum: int,
    maximum: int,
    unit: Unit = NUMBER,
    sign: Sign = Sign.NONE,
) -> Register:
    """Return a setting that is lost at power-off."""
    return Register(
        name, address, size, Access.READ_WRITE, Memory.RAM, initial, minimum, maximum, unit, sign
    )


def fixed(name: str, address: int, size: int, initial: int | None = None) -> Register:
    """Return a constant of the servo."""
    return Register(name, address, size, Access.READ, Memory.EEPROM, initial)


def measured(
    name: str,
    address: int,
    size: int,
    unit: Unit = NUMBER,
    sign: Sign = Sign.NONE,
    initial: int | None = None,
) -> Register:
    """Return something that the servo tells and nobody sets."""
    return Register(name, address, size, Access.READ, Memory.RAM, initial, None, None, unit, sign)


# AX and RX. Moving Speed goes to 1023 in joint mode and to 2047 in wheel mode.


def _ax_table(
    name: str,
    number: int,
    *,
    max_torque: int = 1023,
    temperature_limit: int = 70,
    baud_rate: int = 1,
    highest_voltage: int = 140,
    margin: int = 1,
    slope: int = 32,
) -> ControlTable:
    """Return the table of an AX or RX servo, from the initial values that differ."""
    return ControlTable(
        name,
        (
            fixed("Model Number", 0, 2, number),
            fixed("Firmware Version", 2, 1),
            eeprom("ID", 3, 1, 1, 0, 253),
            eeprom("Baud Rate", 4, 1, baud_rate, 0, 254),
            eeprom("Return Delay Time", 5, 1, 250, 0, 254, DELAY),
            eeprom("CW Angle Limit", 6, 2, 0, 0, 1023, AX_POSITION),
            eeprom("CCW Angle Limit", 8, 2, 1023, 0, 1023, AX_POSITION),
            eeprom("Temperature Limit", 11, 1, temperature_limit, 0, 99, CELSIUS),
            eeprom("Min Voltage Limit", 12, 1, 60, 50, 250, VOLT),
            eeprom("Max Voltage Limit", 13, 1, highest_voltage, 50, 250, VOLT),
            eeprom("Max Torque", 14, 2, max_torque, 0, 1023, PER_MILLE),
            eeprom("Status Return Level", 16, 1, 2, 0, 2),
            eeprom("Alarm LED", 17, 1, 36, 0, 127),
            eeprom("Shutdown", 18, 1, 36, 0, 127),
            ram("Torque Enable", 24, 1, 0, 0, 1),
            ram("LED", 25, 1, 0, 0, 1),
            ram("CW Compliance Margin", 26, 1, margin, 0, 255, AX_OFFSET),
            ram("CCW Compliance Margin", 27, 1, margin, 0, 255, AX_OFFSET),
            ram("CW Compliance Slope", 28, 1, slope, 1, 254, AX_OFFSET),
            ram("CCW Compliance Slope", 29, 1, slope, 1, 254, AX_OFFSET),
            ram("Goal Position", 30, 2, None, 0, 1023, AX_POSITION),
            ram("Moving Speed", 32, 2, 0, 0, 2047, AX_VELOCITY, MAGNITUDE),
            ram("Torque Limit", 34, 2, None, 0, 1023, PER_MILLE),
            measured("Present Position", 36, 2, AX_POSITION),
            measured("Present Speed", 38, 2, AX_VELOCITY, MAGNITUDE),
            measured("Present Load", 40, 2, PER_MILLE, MAGNITUDE),
            measured("Present Voltage", 42, 1, VOLT),
            measured("Present Temperature", 43, 1, CELSIUS),
            measured("Registered", 44, 1, initial=0),
            measured("Moving", 46, 1, initial=0),
            ram("Lock", 47, 1, 0, 0, 1),
            ram("Punch", 48, 2, 32, 32, 1023, PER_MILLE),
        ),
    )


def _rx_table(name: str, number: int) -> ControlTable:
    return _ax_table(name, number, temperature_limit=80, baud_rate=34, highest_voltage=190)


AX_12 = _ax_table("AX-12", 12)
AX_12W = _ax_table("AX-12W", 300, margin=4, slope=64)
AX_18 = _ax_table("AX-18A", 18, max_torque=983, temperature_limit=75)
RX_10 = _rx_table("RX-10", 10)
RX_24F = _rx_table("RX-24F", 24)
RX_28 = _rx_table("RX-28", 28)
RX_64 = _rx_table("RX-64", 64)


# MX with protocol 1.0


def _mx_table(
    name: str,
    number: int,
    *extra: Register,
    speed: Unit = MX_VELOCITY,
    baud_rate: int = 34,
    gains: tuple[int, int, int] = (0, 0, 32),
    punch: int = 0,
) -> ControlTable:
    """Return the table of an MX servo with protocol 1.0; `gains` are D, I and P."""
    d_gain, i_gain, p_gain = gains
    return ControlTable(
        name,
        (
            fixed("Model Number", 0, 2, number),
            fixed("Firmware Version", 2, 1),
            eeprom("ID", 3, 1, 1, 0, 253),
            eeprom("Baud Rate", 4, 1, baud_rate, 0, 254),
            eeprom("Return Delay Time", 5, 1, 250, 0, 254, DELAY),
            eeprom("CW Angle Limit", 6, 2, 0, 0, 4095, MX_POSITION),
            eeprom("CCW Angle Limit", 8, 2, 4095, 0, 4095, MX_POSITION),
            eeprom("Temperature Limit", 11, 1, 80, 0, 99, CELSIUS),
            eeprom("Min Voltage Limit", 12, 1, 60, 50, 250, VOLT),
            eeprom("Max Voltage Limit", 13, 1, 160, 50, 250, VOLT),
            eeprom("Max Torque", 14, 2, 1023, 0, 1023, PER_MILLE),
            eeprom("Status Return Level", 16, 1, 2, 0, 2),
            eeprom("Alarm LED", 17, 1, 36, 0, 127),
            eeprom("Shutdown", 18, 1, 36, 0, 127),
            eeprom("Multi Turn Offset", 20, 2, 0, -24576, 24576, MX_OFFSET, SIGNED),
            eeprom("Resolution Divider", 22, 1, 1, 1, 4),
            ram("Torque Enable", 24, 1, 0, 0, 1),
            ram("LED", 25, 1, 0, 0, 1),
            ram("D Gain", 26, 1, d_gain, 0, 254),
            ram("I Gain", 27, 1, i_gain, 0, 254),
            ram("P Gain", 28, 1, p_gain, 0, 254),
            ram("Goal Position", 30, 2, None, -28672, 28672, MX_POSITION, SIGNED),
            ram("Moving Speed", 32, 2, 0, 0, 2047, speed, MAGNITUDE),
            ram("Torque Limit", 34, 2, None, 0, 1023, PER_MILLE),
            measured("Present Position", 36, 2, MX_POSITION, SIGNED),
            measured("Present Speed", 38, 2, speed, MAGNITUDE),
            measured("Present Load", 40, 2, PER_MILLE, MAGNITUDE),
            measured("Present Voltage", 42, 1, VOLT),
            measured("Present Temperature", 43, 1, CELSIUS),
            measured("Registered", 44, 1, initial=0),
            measured("Moving", 46, 1, initial=0),
            ram("Lock", 47, 1, 0, 0, 1),
            ram("Punch", 48, 2, punch, 0, 1023, PER_MILLE),
            measured("Realtime Tick", 50, 2, MILLISECOND, initial=0),
            ram("Goal Acceleration", 73, 1, 0, 0, 254, MX_RAMP),
            *extra,
        ),
    )


_TORQUE_CONTROL = (
    ram("Current", 68, 2, 2048, 0, 4095, milliampere(4.5, 2048.0)),
    ram("Torque Ctrl Mode Enable", 70, 1, 0, 0, 1),
    ram("Goal Torque", 71, 2, 0, 0, 2047, milliampere(4.5), MAGNITUDE),
)

MX_12W = _mx_table(
    "MX-12W", 360, speed=MX_12W_VELOCITY, baud_rate=1, gains=(8, 0, 8), punch=32
)  # 104 on its page; 360 in ROBOTIS' own programs
MX_28 = _mx_table("MX-28", 29)
MX_64 = _mx_table("MX-64", 310, *_TORQUE_CONTROL)
MX_106 = _mx_table("MX-106", 320, eeprom("Drive Mode", 10, 1, 0, 0, 3), *_TORQUE_CONTROL)


# XL-320. Its page contradicts itself on the bit of the voltage error (2 in the shutdown table, 4
# elsewhere); the shutdown table is followed here.

XL_320 = ControlTable(
    "XL-320",
    (
        fixed("Model Number", 0, 2, 350),
        fixed("Firmware Version", 2, 1),
        eeprom("ID", 3, 1, 1, 0, 252),
        eeprom("Baud Rate", 4, 1, 3, 0, 3),
        eeprom("Return Delay Time", 5, 1, 250, 0, 254, DELAY),
        eeprom("CW Angle Limit", 6, 2, 0, 0, 1023, AX_POSITION),
        eeprom("CCW Angle Limit", 8, 2, 1023, 0, 1023, AX_POSITION),
        eeprom("Control Mode", 11, 1, 2, 1, 2),
        eeprom("Temperature Limit", 12, 1, 65, 0, 150, CELSIUS),
        eeprom("Min Voltage Limit", 13, 1, 60, 50, 250, VOLT),
        eeprom("Max Voltage Limit", 14, 1, 90, 50, 250, VOLT),
        eeprom("Max Torque", 15, 2, 1023, 0, 1023, PER_MILLE),
        eeprom("Status Return Level", 17, 1, 2, 0, 2),
        eeprom("Shutdown", 18, 1, 3, 0, 7),
        ram("Torque Enable", 24, 1, 0, 0, 1),
        ram("LED", 25, 1, 0, 0, 7),
        ram("D Gain", 27, 1, 0, 0, 254),
        ram("I Gain", 28, 1, 0, 0, 254),
        ram("P Gain", 29, 1, 32, 0, 254),
        ram("Goal Position", 30, 2, None, 0, 1023, AX_POSITION),
        ram("Moving Speed", 32, 2, 0, 0, 2047, AX_VELOCITY, MAGNITUDE),
        ram("Torque Limit", 35, 2, None, 0, 1023, PER_MILLE),
        measured("Present Position", 37, 2, AX_POSITION),
        measured("Present Speed", 39, 2, AX_VELOCITY, MAGNITUDE),
        measured("Present Load", 41, 2, PER_MILLE, MAGNITUDE),
        measured("Present Voltage", 45, 1, VOLT),
        measured("Present Temperature", 46, 1, CELSIUS),
        measured("Registered Instruction", 47, 1, initial=0),
        measured("Moving", 49, 1, initial=0),
        measured("Hardware Error Status", 50, 1, initial=0),
        ram("Punch", 51, 2, 32, 0, 1023, PER_MILLE),
    ),
)


# X series and MX(2.0). Their layouts differ in what they have, not in where it is: a table is made
# of what they share, of the values that differ, and of the registers that only some have.

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


_FIVE_VOLTS = Supply(70, 35, 31, 70)
_TWELVE_VOLTS = Supply(160, 95, 95, 160)
_WIDE = Supply(140, 60, 60, 140)
_WIDE_330 = Supply(140, 55, 55, 140)
_XC430 = Supply(160, 60, 60, 160)
_24_VOLTS = Supply(300, 110, 110, 300)


def _x_table(
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
    led: bool = True,
    moving_threshold: int = 10,
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
        led: Whether it has one.
        moving_threshold: Initial speed from which on it counts as moving.
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
            eeprom("Moving Threshold", 24, 4, moving_threshold, 0, 1023, X_VELOCITY),
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
            *((ram("LED", 65, 1, 0, 0, 1),) if led else ()),
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


_STARTUP = eeprom("Startup Configuration", 60, 1, 0, 0, 3)
_BACKUP = measured("Backup Ready", 147, 1, initial=0)
_ACCELERATION_LIMIT = eeprom("Acceleration Limit", 40, 4, 32767, 0, 32767, X_RAMP)
_PWM_SLOPE_5V = eeprom("PWM Slope", 62, 1, 140, 1, 255, Unit("mV/ms", 1.977))
_PWM_SLOPE_12V = eeprom("PWM Slope", 62, 1, 255, 1, 255, Unit("mV/ms", 3.955))
_EXTERNAL_PORTS = tuple(
    register
    for number in (1, 2, 3)
    for register in (
        eeprom(f"External Port Mode {number}", 55 + number, 1, 3, 0, 3),
        ram(f"External Port Data {number}", 150 + 2 * number, 2, 0, 0, 4095),
    )
)

_MX_2_GAINS = Gains(1920, 100, 0, 0, 850)
_XM_GAINS = Gains(1920, 100, 0, 0, 800)
_COMMON = (_STARTUP, _BACKUP)
_XM_CURRENT = milliampere(2.69)
_MX_CURRENT = milliampere(3.36)
_SMALL_CURRENT = milliampere(1.0)

MX_28_2 = _x_table(
    "MX-28(2.0)", 30, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=230,
    gains=_MX_2_GAINS, current=None, extra=(_ACCELERATION_LIMIT, _BACKUP),
)  # fmt: skip
MX_64_2 = _x_table(
    "MX-64(2.0)", 311, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=435,
    gains=_MX_2_GAINS, current=(_MX_CURRENT, 1941), extra=(_ACCELERATION_LIMIT, _BACKUP),
)  # fmt: skip
MX_106_2 = _x_table(
    "MX-106(2.0)", 321, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=360,
    gains=_MX_2_GAINS, current=(_MX_CURRENT, 2047), extra=(_ACCELERATION_LIMIT, _BACKUP),
)  # fmt: skip
XL430_W250 = _x_table(
    "XL430-W250", 1060, temperature_limit=72, supply=_WIDE, velocity_limit=265,
    gains=Gains(1000, 100, 4000, 0, 640), current=None, extra=_COMMON,
)  # fmt: skip
XM430_W210 = _x_table(
    "XM430-W210", 1030, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=330,
    gains=_XM_GAINS, current=(_XM_CURRENT, 1193), extra=_COMMON,
)  # fmt: skip
XM430_W350 = _x_table(
    "XM430-W350", 1020, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=200,
    gains=_XM_GAINS, current=(_XM_CURRENT, 1193), extra=_COMMON,
)  # fmt: skip
XM540_W150 = _x_table(
    "XM540-W150", 1130, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=230,
    gains=_XM_GAINS, current=(_XM_CURRENT, 2047), extra=(*_COMMON, *_EXTERNAL_PORTS),
)  # fmt: skip
XM540_W270 = _x_table(
    "XM540-W270", 1120, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=128,
    gains=_XM_GAINS, current=(_XM_CURRENT, 2047), extra=(*_COMMON, *_EXTERNAL_PORTS),
)  # fmt: skip
XL330_M077 = _x_table(
    "XL330-M077", 1190, temperature_limit=70, supply=_FIVE_VOLTS, velocity_limit=1620,
    gains=Gains(400, 40, 0, 400, 400), current=(_SMALL_CURRENT, 1750),
    extra=(*_COMMON, _PWM_SLOPE_5V), small=True, shutdown=53,
)  # fmt: skip
XL330_M288 = _x_table(
    "XL330-M288", 1200, temperature_limit=70, supply=_FIVE_VOLTS, velocity_limit=445,
    gains=Gains(1600, 180, 0, 0, 400), current=(_SMALL_CURRENT, 1750),
    extra=(*_COMMON, _PWM_SLOPE_5V), small=True, shutdown=53,
)  # fmt: skip
XC330_M181 = _x_table(
    "XC330-M181", 1230, temperature_limit=70, supply=_FIVE_VOLTS, velocity_limit=545,
    gains=Gains(1400, 100, 500, 0, 1200), current=(_SMALL_CURRENT, 2352),
    extra=(*_COMMON, _PWM_SLOPE_5V), small=True,
)  # fmt: skip
XC330_M288 = _x_table(
    "XC330-M288", 1240, temperature_limit=70, supply=_FIVE_VOLTS, velocity_limit=350,
    gains=Gains(1600, 50, 500, 0, 1100), current=(_SMALL_CURRENT, 2352),
    extra=(*_COMMON, _PWM_SLOPE_5V), small=True,
)  # fmt: skip
XC330_T181 = _x_table(
    "XC330-T181", 1210, temperature_limit=70, supply=_WIDE_330, velocity_limit=510,
    gains=Gains(1200, 40, 0, 0, 900), current=(_SMALL_CURRENT, 910),
    extra=(*_COMMON, _PWM_SLOPE_12V), small=True,
)  # fmt: skip
XC330_T288 = _x_table(
    "XC330-T288", 1220, temperature_limit=70, supply=_WIDE_330, velocity_limit=320,
    gains=Gains(1200, 40, 0, 0, 900), current=(_SMALL_CURRENT, 910),
    extra=(*_COMMON, _PWM_SLOPE_12V), small=True,
)  # fmt: skip
XC430_W150 = _x_table(
    "XC430-W150", 1070, temperature_limit=80, supply=_XC430, velocity_limit=460,
    gains=Gains(1920, 100, 0, 0, 460), current=None, extra=_COMMON, moving_threshold=20,
)  # fmt: skip
XL430_W250_2 = _x_table(
    "2XL430-W250", 1090, temperature_limit=72, supply=_WIDE, velocity_limit=250,
    gains=Gains(1800, 100, 2000, 0, 640), current=None, extra=(),
)  # fmt: skip
XH430_W350 = _x_table(
    "XH430-W350", 1000, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=130,
    gains=Gains(1920, 100, 0, 0, 900), current=(_XM_CURRENT, 648), extra=_COMMON,
)  # fmt: skip
XH540_V150 = _x_table(
    "XH540-V150", 1150, temperature_limit=80, supply=_24_VOLTS, velocity_limit=230,
    gains=_XM_GAINS, current=(_XM_CURRENT, 1188), extra=(*_COMMON, *_EXTERNAL_PORTS),
)  # fmt: skip
XW540_T140 = _x_table(
    "XW540-T140", 1180, temperature_limit=80, supply=_TWELVE_VOLTS, velocity_limit=304,
    gains=_XM_GAINS, current=(_XM_CURRENT, 2047), extra=_COMMON, led=False,
)  # fmt: skip
