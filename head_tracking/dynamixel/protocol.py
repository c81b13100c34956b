"""Packets of Dynamixel protocols 1.0 and 2.0.

    1.0   FF FF ID LEN CODE PARAMETERS CHECKSUM
    2.0   FF FF FD 00 ID LEN_L LEN_H CODE PARAMETERS CRC_L CRC_H

CODE is an instruction. In a status packet of protocol 1.0 it is the error byte; in one of 2.0 it is
55, and the error byte is the first parameter. Protocol 2.0 escapes each FF FF FD behind the length
with another FD (byte stuffing). Protocol 1.0 has no escapes: FF FF may occur anywhere.

Source: ROBOTIS e-manual, protocol 1.0 and 2.0. dynamixel_sdk 3.8.4 and 4.1.0 build the same
packets, but without stuffing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum, IntFlag
from typing import Final, NamedTuple

from head_tracking.dynamixel.exceptions import CommunicationError

BROADCAST_ID: Final = 0xFE
MAX_ID: Final = {1: 0xFD, 2: 0xFC}
"""Highest id of a servo, by protocol."""
HEADER: Final = {1: b"\xff\xff", 2: b"\xff\xff\xfd\x00"}
OVERHEAD: Final = {1: 6, 2: 11}
"""Bytes of a status packet besides its data, by protocol."""
LONGEST: Final = {1: 250, 2: 1024}
"""Bytes of the longest packet that dynamixel_sdk sends, by protocol."""
STATUS: Final = 0x55
"""Code of status packets of protocol 2.0."""
ALERT: Final = 0x80
"""Bit of a 2.0 error byte: Hardware Error Status is not 0."""
_STUFFED: Final = b"\xff\xff\xfd"


class Instruction(IntEnum):
    """Instructions that the driver sends."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REBOOT = 0x08
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    BULK_READ = 0x92


class ErrorBits(IntFlag):
    """The error byte of a protocol 1.0 status packet: the state of the servo.

    The data of a reply with OVERLOAD are valid.
    """

    INPUT_VOLTAGE = 1
    ANGLE_LIMIT = 2
    OVERHEATING = 4
    RANGE = 8
    CHECKSUM = 16
    OVERLOAD = 32
    INSTRUCTION = 64


NO_ERROR: Final = ErrorBits(0)
REFUSALS: Final = ErrorBits.ANGLE_LIMIT | ErrorBits.RANGE | ErrorBits.INSTRUCTION
"""Bits that are set when the servo did not execute the instruction."""


class StatusCode(IntEnum):
    """The low seven bits of a 2.0 error byte: a number, not flags."""

    OK = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


class HardwareErrors(IntFlag):
    """Hardware Error Status and Shutdown of the X series and MX(2.0)."""

    INPUT_VOLTAGE = 1
    OVERHEATING = 4
    ENCODER = 8
    ELECTRICAL_SHOCK = 16
    OVERLOAD = 32


class XL320Errors(IntFlag):
    """Hardware Error Status and Shutdown of the XL-320."""

    OVERLOAD = 1
    OVERHEATING = 2
    INPUT_VOLTAGE = 4


def describe_errors(errors: IntFlag) -> str:
    """Return the names of the set bits, such as "overheating, overload", or "none"."""
    names = [(bit.name or "").lower().replace("_", " ") for bit in type(errors) if bit in errors]
    return ", ".join(names) or "none"


def describe_status(error: int) -> str:
    """Return the meaning of a 2.0 error byte, such as "access", or "none"."""
    code = error & ~ALERT
    words = ["alert"] if error & ALERT else []
    if code:
        known = code in StatusCode._value2member_map_
        words.append(StatusCode(code).name.lower().replace("_", " ") if known else f"code {code}")
    return ", ".join(words) or "none"


# Instruction packets


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC_TABLE: Final = _crc_table()


def crc16(data: bytes) -> int:
    """Return the CRC-16 of bytes (polynomial 0x8005, not reflected, initial value 0)."""
    crc, table = 0, _CRC_TABLE
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ table[(crc >> 8) ^ byte]
    return crc


def encode_packet(protocol: int, servo_id: int, code: int, parameters: bytes = b"") -> bytes:
    """Return a packet with header, length, and checksum or CRC.

    Raises:
        CommunicationError: It would be too long.
    """
    if protocol == 1:
        body = bytes((servo_id, len(parameters) + 2 & 0xFF, code)) + parameters
        packet = b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))
    else:
        content = (bytes((code,)) + parameters).replace(_STUFFED, _STUFFED + b"\xfd")
        size = len(content) + 2
        packet = HEADER[2] + bytes((servo_id, size & 0xFF, size >> 8 & 0xFF)) + content
        packet += crc16(packet).to_bytes(2, "little")
    if len(packet) > LONGEST[protocol]:
        raise CommunicationError(
            f"a packet of {len(packet)} bytes is too long; protocol {protocol}.0 allows "
            f"{LONGEST[protocol]}"
        )
    return packet


def read_packet(protocol: int, servo_id: int, address: int, length: int) -> bytes:
    """Return the instruction to read bytes of one servo."""
    where = address.to_bytes(protocol, "little") + length.to_bytes(protocol, "little")
    return encode_packet(protocol, servo_id, Instruction.READ, where)


def write_packet(protocol: int, servo_id: int, address: int, data: bytes) -> bytes:
    """Return the instruction to write bytes of one servo."""
    where = address.to_bytes(protocol, "little")
    return encode_packet(protocol, servo_id, Instruction.WRITE, where + data)


def sync_read_packet(protocol: int, ids: Sequence[int], address: int, length: int) -> bytes:
    """Return the instruction to read the same bytes of several servos (2.0, Feetech STS)."""
    where = address.to_bytes(protocol, "little") + length.to_bytes(protocol, "little")
    return encode_packet(protocol, BROADCAST_ID, Instruction.SYNC_READ, where + bytes(ids))


def bulk_read_packet(ids: Sequence[int], address: int, length: int) -> bytes:
    """Return the instruction to read the same bytes of several MX servos with protocol 1.0."""
    shares = b"".join(bytes((length, servo_id, address)) for servo_id in ids)
    return encode_packet(1, BROADCAST_ID, Instruction.BULK_READ, b"\x00" + shares)


def sync_write_packet(protocol: int, address: int, data: Mapping[int, bytes]) -> bytes:
    """Return the instruction to write the same registers of several servos; all data are as long.

    Raises:
        CommunicationError: There are too many.
    """
    length = len(next(iter(data.values())))
    head = address.to_bytes(protocol, "little") + length.to_bytes(protocol, "little")
    shares = b"".join([bytes((servo_id,)) + share for servo_id, share in data.items()])
    return encode_packet(protocol, BROADCAST_ID, Instruction.SYNC_WRITE, head + shares)


# Status packets


class Status(NamedTuple):
    """The reply of a servo."""

    id: int
    # Error byte. Protocol 1.0: the state of the servo (`ErrorBits`). Protocol 2.0: a `StatusCode`
    # and the alert bit.
    error: int
    data: bytes = b""  # without stuffing
    # Time at which the servo had received the instruction, on the port's clock, s.
    stamp: float = 0.0


def status_prefix(protocol: int, servo_id: int, length: int) -> bytes:
    """Return the first bytes of a status packet with so many bytes of data (not stuffed)."""
    if protocol == 1:
        return b"\xff\xff" + bytes((servo_id, length + 2 & 0xFF))
    size = length + 4
    return HEADER[2] + bytes((servo_id, size & 0xFF, size >> 8, STATUS))


def is_valid(protocol: int, packet: bytes) -> bool:
    """Return whether the checksum (1.0) or CRC (2.0) of a whole packet is right."""
    if protocol == 1:
        return sum(packet) & 0xFF == 0xFD  # FF twice, and the sum that the checksum makes FF
    return crc16(packet[:-2]) == packet[-2] | packet[-1] << 8


def decode_status(protocol: int, packet: bytes, stamp: float = 0.0) -> Status | None:
    """Return the contents of a whole packet; None if it is damaged or an instruction.

    The echo of a protocol 1.0 instruction may look like a status packet.
    """
    if protocol == 1:
        if sum(packet) & 0xFF != 0xFD or packet[4] > 0x7F or packet[2] == BROADCAST_ID:
            return None
        return Status(packet[2], packet[4], packet[5:-1], stamp)
    if not is_valid(2, packet) or packet[7] != STATUS or len(packet) < OVERHEAD[2]:
        return None
    data = packet[9:-2]
    if _STUFFED in packet[7:-2]:
        data = packet[7:-2].replace(_STUFFED + b"\xfd", _STUFFED)[2:]
    return Status(packet[4], packet[8], data, stamp)


class Found(NamedTuple):
    """The first valid packet in a buffer."""

    packet: bytes  # its bytes; empty if there is none (yet)
    end: int  # its end in the buffer
    damaged: bool  # whether a whole packet with a wrong checksum precedes it, or is in the buffer


def find_packet(protocol: int, buffer: bytes) -> Found:
    """Return the first valid packet in a buffer.

    Noise that looks like a header does not hide the packets behind it.
    """
    header = HEADER[protocol]
    damaged = False
    start = buffer.find(header)
    while start >= 0:
        end = start + _packet_length(protocol, buffer, start + len(header))
        if start < end <= len(buffer):
            packet = buffer[start:end]
            if is_valid(protocol, packet):
                return Found(packet, end, damaged)
            damaged = True
        start = buffer.find(header, start + 1)
    return Found(b"", 0, damaged)


def _packet_length(protocol: int, buffer: bytes, start: int) -> int:
    """Return the length, in bytes, of the packet whose id is at `start`; 0: no packet (yet)."""
    body = start + 1 + protocol
    if body > len(buffer):
        return 0
    servo_id, length = buffer[start], int.from_bytes(buffer[start + 1 : body], "little")
    whole = body - start + len(HEADER[protocol]) + length
    if servo_id > MAX_ID[protocol] and servo_id != BROADCAST_ID:
        return 0
    return whole if length > protocol and whole <= LONGEST[protocol] else 0
