"""Packets as servos receive and send them; independent of the driver's codec.

    1.0   FF FF ID LENGTH CODE PARAMETERS CHECKSUM
    2.0   FF FF FD 00 ID LENGTH_L LENGTH_H CODE PARAMETERS CRC_L CRC_H

CODE is the instruction. In a status packet of protocol 1.0 it is the error byte; in one of protocol
2.0 it is 0x55, and the error byte is the first parameter. Source: ROBOTIS e-manual, protocols.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

BROADCAST: Final = 254
STATUS: Final = 0x55
ALERT: Final = 0x80
LONGEST: Final = {1: 250, 2: 1024}  # bytes of a packet
_PRELUDE: Final = {1: b"\xff\xff", 2: b"\xff\xff\xfd\x00"}
_HIGHEST_ID: Final = {1: 253, 2: 252}
_POLYNOMIAL: Final = 0x18005
_LONGEST_GAP: Final = {1: 100_000_000, 2: 10_000_000}
"""Pause within a packet after which a servo discards it, ns (e-manual, protocol 1.0). Protocol 2.0
states 1.5 ms, but the scheduler of this computer may cause longer pauses."""


class Instruction(IntEnum):
    """Instruction codes."""

    PING = 1
    READ = 2
    WRITE = 3
    REBOOT = 8
    SYNC_READ = 130
    SYNC_WRITE = 131
    BULK_READ = 146


class Packet(NamedTuple):
    """An undamaged packet: id of the servo or BROADCAST, code, parameters without byte stuffing."""

    id: int
    code: int
    parameters: bytes = b""


class DamagedPacket(NamedTuple):
    """A packet with a wrong checksum, and the id in it."""

    id: int


class Status(NamedTuple):
    """A status packet: id of the servo, error byte, data without byte stuffing."""

    id: int
    error: int
    data: bytes = b""


def _divide(byte: int) -> int:
    """Return the remainder of a byte, followed by 16 zeros, by the polynomial."""
    value = byte << 16
    for bit in range(23, 15, -1):
        if value >> bit & 1:
            value ^= _POLYNOMIAL << bit - 16
    return value


_REMAINDERS: Final = tuple(map(_divide, range(256)))


def crc(data: bytes) -> int:
    """Return the CRC-16 that closes packets of protocol 2.0."""
    value = 0
    for byte in data:
        value = (value & 0xFF) << 8 ^ _REMAINDERS[value >> 8 ^ byte]
    return value


def encode(protocol: int, packet: Packet) -> bytes:
    """Return a packet as bytes."""
    servo_id, code, parameters = packet
    if protocol == 1:
        body = bytes([servo_id, (len(parameters) + 2) % 256, code, *parameters])
        return b"\xff\xff" + body + bytes([255 - sum(body) % 256])
    content = bytes([code]) + parameters
    content = content.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = b"\xff\xff\xfd\x00" + bytes([servo_id]) + (len(content) + 2).to_bytes(2, "little")
    return head + content + crc(head + content).to_bytes(2, "little")


def encode_status(protocol: int, status: Status) -> bytes:
    """Return a status packet as bytes."""
    if protocol == 1:
        return encode(1, Packet(status.id, status.error, status.data))
    return encode(2, Packet(status.id, STATUS, bytes([status.error]) + status.data))


def decode(protocol: int, data: bytes) -> Packet | None:
    """Return the packet in these bytes; None if they are not exactly one undamaged packet."""
    if size_of_packet(protocol, data) != len(data):
        return None
    if protocol == 1:
        whole = sum(data[2:]) % 256 == 255
        return Packet(data[2], data[4], data[5:-1]) if whole else None
    if crc(data[:-2]) != int.from_bytes(data[-2:], "little"):
        return None
    content = data[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
    return Packet(data[4], content[0], content[1:])


def decode_status(protocol: int, data: bytes) -> Status | None:
    """Return the status packet in these bytes; None if they are not exactly one."""
    packet = decode(protocol, data)
    if packet is None:
        return None
    if protocol == 1:
        return Status(*packet)
    if packet.code != STATUS or not packet.parameters:
        return None
    return Status(packet.id, packet.parameters[0], packet.parameters[1:])


def size_of_packet(protocol: int, data: bytes) -> int:
    """Return the size of the packet that begins here.

    Returns:
        Size in bytes; 0 if more bytes are needed to know it; -1 if no packet begins here.
    """
    prelude = _PRELUDE[protocol]
    if data[: len(prelude)] != prelude:
        return 0 if prelude[: len(data)] == data else -1
    rest = data[len(prelude) :]
    if rest and rest[0] != BROADCAST and rest[0] > _HIGHEST_ID[protocol]:
        return -1
    if len(rest) < 1 + protocol:
        return 0
    length = int.from_bytes(rest[1 : 1 + protocol], "little")
    size = len(prelude) + 1 + protocol + length
    return size if length > protocol and size <= LONGEST[protocol] else -1


class PacketParser:
    """Finds packets in a stream of bytes as a servo does.

    A damaged packet is reported; the bytes that its length field covers are lost with it.

    Args:
        protocol: 1 or 2.
    """

    def __init__(self, protocol: int) -> None:
        self._protocol = protocol
        self._held = b""
        self._last = 0

    def feed(self, data: bytes, now: int) -> list[Packet | DamagedPacket]:
        """Return the packets that these bytes complete.

        Args:
            data: Received bytes.
            now: Time of their arrival, ns.
        """
        held = self._held + data if now - self._last <= _LONGEST_GAP[self._protocol] else data
        self._last = now
        found: list[Packet | DamagedPacket] = []
        while held and (size := size_of_packet(self._protocol, held)):
            if size < 0:
                following = held.find(0xFF, 1)
                held = held[following:] if following > 0 else b""
                continue
            if size > len(held):
                break
            packet = decode(self._protocol, held[:size])
            found.append(packet or DamagedPacket(held[len(_PRELUDE[self._protocol])]))
            held = held[size:]
        self._held = held
        return found
