"""MX-28, MX-64 and MX-106 with protocol 1.0: ROBOTIS e-manual pages MX-28, MX-64 and MX-106.

Where the pages give no range, the range is that of the AX servos, whose layout they share.
"""

from __future__ import annotations

from head_tracking.dynamixel.control_table import ControlTable, Register
from head_tracking.dynamixel.tables.row import MAGNITUDE, SIGNED, eeprom, fixed, measured, ram
from head_tracking.dynamixel.units import (
    CELSIUS,
    DELAY,
    MILLISECOND,
    MX_OFFSET,
    MX_POSITION,
    MX_RAMP,
    MX_VELOCITY,
    PER_MILLE,
    VOLT,
    milliampere,
)


def _table(name: str, number: int, *extra: Register) -> ControlTable:
    return ControlTable(
        name,
        (
            fixed("Model Number", 0, 2, number),
            fixed("Firmware Version", 2, 1),
            eeprom("ID", 3, 1, 1, 0, 253),
            eeprom("Baud Rate", 4, 1, 34, 0, 254),
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
            ram("D Gain", 26, 1, 0, 0, 254),
            ram("I Gain", 27, 1, 0, 0, 254),
            ram("P Gain", 28, 1, 32, 0, 254),
            ram("Goal Position", 30, 2, None, -28672, 28672, MX_POSITION, SIGNED),
            ram("Moving Speed", 32, 2, 0, 0, 2047, MX_VELOCITY, MAGNITUDE),
            ram("Torque Limit", 34, 2, None, 0, 1023, PER_MILLE),
            measured("Present Position", 36, 2, MX_POSITION, SIGNED),
            measured("Present Speed", 38, 2, MX_VELOCITY, MAGNITUDE),
            measured("Present Load", 40, 2, PER_MILLE, MAGNITUDE),
            measured("Present Voltage", 42, 1, VOLT),
            measured("Present Temperature", 43, 1, CELSIUS),
            measured("Registered", 44, 1, initial=0),
            measured("Moving", 46, 1, initial=0),
            ram("Lock", 47, 1, 0, 0, 1),
            ram("Punch", 48, 2, 0, 0, 1023, PER_MILLE),
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

MX_28 = _table("MX-28", 29)
MX_64 = _table("MX-64", 310, *_TORQUE_CONTROL)
MX_106 = _table("MX-106", 320, eeprom("Drive Mode", 10, 1, 0, 0, 3), *_TORQUE_CONTROL)
