"""Codes, checksum and stuffing of Dynamixel protocol 2.0 that the driver and the simulator share.

Source: ROBOTIS e-manual, protocol 2.0.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

HEADER: Final = b"\xff\xff\xfd\x00"
BROADCAST_ID: Final = 0xFE
MAX_ID: Final = 0xFC
"""Highest id a servo can have; 253 would look like a header."""

STATUS: Final = 0x55
"""Instruction code of status packets."""

ALERT: Final = 0x80
"""Bit of the error byte: look at Hardware Error Status."""

CLEAR_MULTI_TURN: Final = b"\x01\x44\x58\x4c\x22"
"""Parameters of CLEAR that fold the present position into one turn."""

_STUFFED: Final = b"\xff\xff\xfd"


class Instruction2(IntEnum):
    """Instruction codes of protocol 2.0."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class StatusCode(IntEnum):
    """The low seven bits of a status packet's error byte: a number, not flags."""

    OK = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


def describe_status(error: int) -> str:
    """Return the error byte in words, such as "access", or "none"."""
    code = error & ~ALERT
    words = ["alert"] if error & ALERT else []
    if code:
        try:
            words.append(StatusCode(code).name.lower().replace("_", " "))
        except ValueError:
            words.append(f"code {code}")
    return ", ".join(words) or "none"


def _table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC_TABLE: Final = _table()


def crc16(data: bytes | bytearray | memoryview, crc: int = 0) -> int:
    """Return the CRC-16 (polynomial 0x8005, not reflected, initially 0) of bytes.

    Args:
        data: The bytes, from the first header byte on.
        crc: CRC of what came before.
    """
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ _CRC_TABLE[(crc >> 8) ^ byte]
    return crc


def stuff(content: bytes) -> bytes:
    """Insert an FD after each FF FF FD, so that it does not look like a header.

    Args:
        content: Instruction to last parameter. What stands before an instruction never matters.
    """
    return content.replace(_STUFFED, _STUFFED + b"\xfd")


def unstuff(content: bytes) -> bytes:
    """Take the inserted FDs out again; inverse of `stuff`."""
    return content.replace(_STUFFED + b"\xfd", _STUFFED)
