"""XL-320: ROBOTIS e-manual page XL-320.

The page contradicts itself on the bit of the voltage error (2 in the shutdown table, 4 elsewhere);
the shutdown table is followed here.
"""

from __future__ import annotations

from head_tracking.dynamixel.control_table import ControlTable
from head_tracking.dynamixel.tables.row import MAGNITUDE, eeprom, fixed, measured, ram
from head_tracking.dynamixel.units import (
    AX_POSITION,
    AX_VELOCITY,
    CELSIUS,
    DELAY,
    PER_MILLE,
    VOLT,
)

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
