"""Codes of Dynamixel protocol 1.0 that the driver and the simulator share."""

from __future__ import annotations

from enum import IntEnum, IntFlag

BROADCAST_ID = 0xFE
"""Every servo listens to this id and none answers it."""

MAX_ID = 0xFD
"""Highest id a servo can have."""


class Instruction(IntEnum):
    """Instruction codes of protocol 1.0 (ROBOTIS e-manual, protocol 1.0)."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    SYNC_WRITE = 0x83
    BULK_READ = 0x92


class ErrorBits(IntFlag):
    """The error byte of a protocol 1.0 status packet.

    It is the servo's state, not a verdict on the call: a read that is answered with OVERLOAD set
    still carries valid data.
    """

    INPUT_VOLTAGE = 1
    ANGLE_LIMIT = 2
    OVERHEATING = 4
    RANGE = 8
    CHECKSUM = 16
    OVERLOAD = 32
    INSTRUCTION = 64


NO_ERROR = ErrorBits(0)

REFUSALS = ErrorBits.ANGLE_LIMIT | ErrorBits.RANGE | ErrorBits.INSTRUCTION
"""Bits by which a servo says that it did not do what the packet asked."""


def describe_errors(errors: IntFlag) -> str:
    """Return the set bits in words, such as "overheating, overload", or "none"."""
    names = [(bit.name or "").lower().replace("_", " ") for bit in type(errors) if bit in errors]
    return ", ".join(names) or "none"
