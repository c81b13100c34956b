"""Feetech servos for the servo bus of `head_tracking.dynamixel`.

A Feetech servo is a model like any other: port, cycle, faults and tools are those of the Dynamixel
driver. Files in `tables/` describe the models, in the same format.

Packets are those of Dynamixel protocol 1.0. Of protocol 2.0 all know `REBOOT`, to which they send
no reply, and STS servos `SYNC_READ`. Values of two bytes are sent low byte first by STS servos,
high byte first by SCS servos. Numbers with a sign are magnitude and sign bit, never two's
complement. The error byte of a reply is the state of the servo and never refuses a request.

Source: ftservo-wiki 9522ce1, reference/protocol/ft-scs.md and reference/parameter/.
"""

from __future__ import annotations

from enum import IntFlag
from pathlib import Path
from typing import Final

TABLES: Final = Path(__file__).parent / "tables"
"""Where the data files of the models are."""

BYTE_ORDERS: Final = {"STS": "little", "SCS": "big"}
"""Order of the bytes of a value, by family."""


class FeetechErrors(IntFlag):
    """Status, Hardware Error Status and Shutdown: what is wrong with the servo itself."""

    INPUT_VOLTAGE = 1
    ENCODER = 2
    OVERHEATING = 4
    OVERCURRENT = 8
    OVERLOAD = 32
