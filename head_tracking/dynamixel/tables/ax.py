"""AX-12, AX-12+, AX-12A and AX-18A: ROBOTIS e-manual pages AX-12A and AX-18A.

Ranges are also from the AX-12 manual of 2006. Moving Speed goes to 1023 in joint mode and to 2047
in wheel mode.
"""

from __future__ import annotations

from head_tracking.dynamixel.control_table import ControlTable
from head_tracking.dynamixel.tables.row import MAGNITUDE, eeprom, fixed, measured, ram
from head_tracking.dynamixel.units import (
    AX_OFFSET,
    AX_POSITION,
    AX_VELOCITY,
    CELSIUS,
    DELAY,
    PER_MILLE,
    VOLT,
)


def _table(name: str, number: int, max_torque: int, temperature_limit: int) -> ControlTable:
    return ControlTable(
        name,
        (
            fixed("Model Number", 0, 2, number),
            fixed("Firmware Version", 2, 1),
            eeprom("ID", 3, 1, 1, 0, 253),
            eeprom("Baud Rate", 4, 1, 1, 0, 254),
            eeprom("Return Delay Time", 5, 1, 250, 0, 254, DELAY),
            eeprom("CW Angle Limit", 6, 2, 0, 0, 1023, AX_POSITION),
            eeprom("CCW Angle Limit", 8, 2, 1023, 0, 1023, AX_POSITION),
            eeprom("Temperature Limit", 11, 1, temperature_limit, 0, 99, CELSIUS),
            eeprom("Min Voltage Limit", 12, 1, 60, 50, 250, VOLT),
            eeprom("Max Voltage Limit", 13, 1, 140, 50, 250, VOLT),
            eeprom("Max Torque", 14, 2, max_torque, 0, 1023, PER_MILLE),
            eeprom("Status Return Level", 16, 1, 2, 0, 2),
            eeprom("Alarm LED", 17, 1, 36, 0, 127),
            eeprom("Shutdown", 18, 1, 36, 0, 127),
            ram("Torque Enable", 24, 1, 0, 0, 1),
            ram("LED", 25, 1, 0, 0, 1),
            ram("CW Compliance Margin", 26, 1, 1, 0, 255, AX_OFFSET),
            ram("CCW Compliance Margin", 27, 1, 1, 0, 255, AX_OFFSET),
            ram("CW Compliance Slope", 28, 1, 32, 1, 254, AX_OFFSET),
            ram("CCW Compliance Slope", 29, 1, 32, 1, 254, AX_OFFSET),
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


AX_12 = _table("AX-12", 12, 1023, 70)
AX_18 = _table("AX-18A", 18, 983, 75)
