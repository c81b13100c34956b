"""What a protocol 2.0 servo writes into its Hardware Error Status, by family."""

from __future__ import annotations

from enum import IntFlag


class HardwareErrors(IntFlag):
    """Hardware Error Status and Shutdown of the X series and MX(2.0)."""

    INPUT_VOLTAGE = 1
    OVERHEATING = 4
    ENCODER = 8
    ELECTRICAL_SHOCK = 16
    OVERLOAD = 32


class XL320Errors(IntFlag):
    """Hardware Error Status and Shutdown of the XL-320, which has bits of its own."""

    OVERLOAD = 1
    OVERHEATING = 2
    INPUT_VOLTAGE = 4
