"""Packets of Dynamixel protocols 1.0 and 2.0, as the driver and the simulator exchange them.

    1.0   FF FF ID LEN CODE PARAMETERS CHECKSUM
    2.0   FF FF FD 00 ID LEN_L LEN_H CODE PARAMETERS CRC_L CRC_H

The code is an instruction. In a status packet of protocol 1.0 it is the error byte; in one of 2.0
it is 55, and the error byte is the first parameter. Each FF FF FD behind the length of a 2.0 packet
is followed by another FD (byte stuffing), so that it does not look like a header. Protocol 1.0 has
no escapes: FF FF may occur anywhere.

Source: ROBOTIS e-manual, protocol 1.0 and protocol 2.0. dynamixel_sdk builds the same packets,
except those that need stuffing, which it sends without (3.8.4 and 4.1.0).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum, IntFlag
from typing import Final, NamedTuple

from head_tracking.dynamixel.exceptions import CommunicationError

BROADCAST_ID: Final = 0xFE
"""Every servo listens to this id."""

MAX_ID: Final = {1: 0xFD, 2: 0xFC}
"""Highest id a servo can have, by protocol; in 2.0, FD would look like a header."""

HEADER: Final = {1: b"\xff\xff", 2: b"\xff\xff\xfd\x00"}
"""How a packet begins, by protocol."""

OVERHEAD: Final = {1: 6, 2: 11}
"""Bytes of a status packet besides its data, by protocol."""

LONGEST: Final = {1: 250, 2: 1024}
"""Bytes of the longest packet that dynamixel_sdk sends and servos take, by protocol."""

STATUS: Final = 0x55
"""Code of status packets of protocol 2.0."""

ALERT: Final = 0x80
"""Bit of a 2.0 error byte: look at Hardware Error Status."""

CLEAR_MULTI_TURN: Final = b"\x01\x44\x58\x4c\x22"
"""Parameters of CLEAR that fold the present position into one turn."""


class Instruction(IntEnum):
    """What a packet asks for. From REBOOT on, only BULK_READ and SYNC_WRITE are also in 1.0."""

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


NO_ERROR: Final = ErrorBits(0)

REFUSALS: Final = ErrorBits.ANGLE_LIMIT | ErrorBits.RANGE | ErrorBits.INSTRUCTION
"""Bits by which a servo says that it did not do what the packet asked."""


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
    """Hardware Error Status and Shutdown of the XL-320, which has bits of its own."""

    OVERLOAD = 1
    OVERHEATING = 2
    INPUT_VOLTAGE = 4


def describe_errors(errors: IntFlag) -> str:
    """Return the set bits in words, such as "overheating, overload", or "none"."""
    names = [(bit.name or "").lower().replace("_", " ") for bit in type(errors) if bit in errors]
    return ", ".join(names) or "none"


def describe_status(error: int) -> str:
    """Return a 2.0 error byte in words, such as "access", or "none"."""
    code = error & ~ALERT
    words = ["alert"] if error & ALERT else []
    if code:
        try:
            words.append(StatusCode(code).name.lower().replace("_", " "))
        except ValueError:
            words.append(f"code {code}")
    return ", ".join(words) or "none"


# Checksums and stuffing


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC_TABLE: Final = _crc_table()
_STUFFED: Final = b"\xff\xff\xfd"


def crc16(data: bytes | bytearray | memoryview) -> int:
    """Return the CRC-16 (polynomial 0x8005, not reflected, initially 0) of bytes."""
    crc, table = 0, _CRC_TABLE
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ table[(crc >> 8) ^ byte]
    return crc


def stuff(content: bytes) -> bytes:
    """Insert an FD after each FF FF FD.

    Args:
        content: Instruction to last parameter. What stands before an instruction never matters.
    """
    return content.replace(_STUFFED, _STUFFED + b"\xfd")


def unstuff(content: bytes) -> bytes:
    """Take the inserted FDs out again; inverse of `stuff`."""
    return content.replace(_STUFFED + b"\xfd", _STUFFED)


# Packets


class Packet(NamedTuple):
    """A packet whose checksum fits.

    Attributes:
        id: The servo, or BROADCAST_ID.
        code: The instruction; unknown ones can occur. See the module for status packets.
        parameters: What follows, not stuffed.
    """

    id: int
    code: int
    parameters: bytes = b""


class Status(NamedTuple):
    """What a servo answers.

    Attributes:
        id: The servo.
        error: Its error byte.
        data: What it carries, not stuffed.
    """

    id: int
    error: int
    data: bytes = b""


def encode_packet(protocol: int, servo_id: int, code: int, parameters: bytes = b"") -> bytes:
    """Return a packet as it goes over the wire.

    Raises:
        CommunicationError: It would be too long.
    """
    if protocol == 1:
        body = bytes((servo_id, len(parameters) + 2 & 0xFF, code)) + parameters
        packet = b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))
    else:
        content = stuff(bytes((code,)) + parameters)
        size = len(content) + 2
        packet = HEADER[2] + bytes((servo_id, size & 0xFF, size >> 8 & 0xFF)) + content
        packet += crc16(packet).to_bytes(2, "little")
    if len(packet) > LONGEST[protocol]:
        raise CommunicationError(
            f"a packet of {len(packet)} bytes is too long; protocol {protocol}.0 allows "
            f"{LONGEST[protocol]}"
        )
    return packet


def encode_status(protocol: int, status: Status) -> bytes:
    """Return a status packet as it goes over the wire; raises as `encode_packet` does."""
    if protocol == 1:
        return encode_packet(1, status.id, status.error, status.data)
    return encode_packet(2, status.id, STATUS, bytes((status.error,)) + status.data)


def decode_packet(protocol: int, packet: bytes) -> Packet | None:
    """Return what the bytes say if they are exactly one undamaged packet; mirrors the encoder."""
    if packet_length(protocol, packet) != len(packet):
        return None
    if protocol == 1:
        if ~sum(packet[2:-1]) & 0xFF != packet[-1]:
            return None
        return Packet(packet[2], packet[4], packet[5:-1])
    if crc16(packet[:-2]) != packet[-2] | packet[-1] << 8:
        return None
    content = unstuff(packet[7:-2])
    return Packet(packet[4], content[0], content[1:])


def packet_length(protocol: int, buffer: bytes | bytearray, start: int = 0) -> int:
    """Return the length of the packet that seems to begin at `start`, in bytes.

    Returns:
        That length; 0 while too little of it is there to tell; -1 if no packet begins here.
    """
    header = HEADER[protocol]
    begin = bytes(buffer[start : start + 7])
    if not begin.startswith(header):
        return 0 if header.startswith(begin) else -1
    size = len(header)
    if len(begin) > size:
        servo_id = begin[size]
        if servo_id > MAX_ID[protocol] and servo_id != BROADCAST_ID:
            return -1
    if protocol == 1:
        if len(begin) < 4:
            return 0
        return begin[3] + 4 if 2 <= begin[3] <= LONGEST[1] - 4 else -1
    if len(begin) < 7:
        return 0
    length = begin[5] | begin[6] << 8
    return length + 7 if 3 <= length <= LONGEST[2] - 7 else -1


# What the driver asks


def read_packet(protocol: int, servo_id: int, address: int, length: int) -> bytes:
    """Return the request for `length` bytes from `address` on."""
    size = protocol  # bytes of an address
    where = address.to_bytes(size, "little") + length.to_bytes(size, "little")
    return encode_packet(protocol, servo_id, Instruction.READ, where)


def write_packet(protocol: int, servo_id: int, address: int, data: bytes) -> bytes:
    """Return the instruction to write bytes from `address` on."""
    where = address.to_bytes(protocol, "little")
    return encode_packet(protocol, servo_id, Instruction.WRITE, where + data)


def sync_read_packet(ids: Sequence[int], address: int, length: int, *, fast: bool = False) -> bytes:
    """Return the request for the same bytes of several servos of protocol 2.0."""
    code = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
    where = address.to_bytes(2, "little") + length.to_bytes(2, "little")
    return encode_packet(2, BROADCAST_ID, code, where + bytes(ids))


def bulk_read_packet(ids: Sequence[int], address: int, length: int) -> bytes:
    """Return the request for the same bytes of several MX servos with protocol 1.0."""
    shares = b"".join(bytes((length, servo_id, address)) for servo_id in ids)
    return encode_packet(1, BROADCAST_ID, Instruction.BULK_READ, b"\x00" + shares)


def sync_write_packet(protocol: int, address: int, data: Mapping[int, bytes]) -> bytes:
    """Return the instruction to write the same registers of several servos, by id.

    Raises:
        CommunicationError: The shares differ in length, or there are too many.
    """
    lengths = set(map(len, data.values()))
    if len(lengths) != 1:
        raise CommunicationError("a sync write needs the same number of bytes for every servo")
    head = address.to_bytes(protocol, "little") + lengths.pop().to_bytes(protocol, "little")
    shares = b"".join([bytes((servo_id,)) + share for servo_id, share in data.items()])
    return encode_packet(protocol, BROADCAST_ID, Instruction.SYNC_WRITE, head + shares)


# What a servo answers


def joint_status(shares: Sequence[Status], lengths: Sequence[int]) -> bytes:
    """Return the one answer of several servos to a fast sync or bulk read; it is not stuffed.

    Each CRC covers all that was sent so far.

    Args:
        shares: What each servo says, as far as they are there.
        lengths: Bytes of data of each servo that was asked.
    """
    size = 1 + sum(length + 4 for length in lengths)
    packet = HEADER[2] + bytes((BROADCAST_ID,)) + size.to_bytes(2, "little") + bytes((STATUS,))
    for share, length in zip(shares, lengths, strict=False):
        packet += bytes((share.error, share.id)) + share.data.ljust(length, b"\0")
        packet += crc16(packet).to_bytes(2, "little")
    return packet


def joint_status_size(count: int, length: int) -> int:
    """Return how many bytes of data the joint answer to a fast sync read has."""
    return (length + 4) * count - 3


def split_joint_status(status: Status, length: int, count: int) -> list[Status]:
    """Return what each servo said in the joint answer to a fast sync read; [] if it is odd.

    Each share is ERROR ID DATA and a CRC of the joint packet so far; the last one's is the packet's
    own and has been checked.

    Args:
        status: The joint answer; its error byte is the first servo's.
        length: Bytes of data of each servo.
        count: Number of servos.
    """
    content = bytes((status.error,)) + status.data
    size = length + 4
    if len(content) != size * count - 2:
        return []
    shares = [content[start : start + size] for start in range(0, len(content), size)]
    return [Status(share[1], share[0], share[2 : 2 + length]) for share in shares]


class Found(NamedTuple):
    """The first status packet in a buffer.

    Attributes:
        status: What it says; None if there is none (yet).
        packet: Its bytes.
        end: Where it ends in the buffer.
        damaged: Whether there is a whole packet with a wrong checksum before it, or at all.
    """

    status: Status | None
    packet: bytes
    end: int
    damaged: bool


def find_status(protocol: int, buffer: bytes | bytearray) -> Found:
    """Return the first status packet in a buffer, whatever stands before it.

    What only seems to begin a packet, because noise looks like a header, does not hide the packets
    behind it. In protocol 1.0 the echo of an instruction looks like a status packet.
    """
    header = HEADER[protocol]
    damaged = False
    start = buffer.find(header)
    while start >= 0:
        length = packet_length(protocol, buffer, start)
        code_at = start + len(header) + protocol + 1
        complete = 0 < length <= len(buffer) - start
        if complete and (buffer[code_at] <= 0x7F if protocol == 1 else buffer[code_at] == STATUS):
            end = start + length
            packet = bytes(buffer[start:end])
            status = _status(protocol, packet)
            if status is not None:
                return Found(status, packet, end, damaged)
            damaged = True
        start = buffer.find(header, start + 1)
    return Found(None, b"", 0, damaged)


def _status(protocol: int, packet: bytes) -> Status | None:
    found = decode_packet(protocol, packet)
    if found is None or (protocol == 1 and found.id == BROADCAST_ID):
        return None
    if protocol == 1:
        return Status(found.id, found.code, found.parameters)
    if found.id == BROADCAST_ID:  # a fast sync read's, which is not stuffed
        return Status(found.id, packet[8], packet[9:-2]) if len(packet) > 10 else None
    return Status(found.id, found.parameters[0], found.parameters[1:]) if found.parameters else None


# What a servo hears


class DamagedPacket(NamedTuple):
    """A packet whose checksum does not fit.

    Attributes:
        id: The servo it seems to be for.
    """

    id: int


class PacketParser:
    """Finds packets in a stream of bytes, however it is cut, as a servo does.

    After a wrong checksum or an impossible length the search goes on right behind the header that
    misled it; a damaged packet is told once.

    Args:
        protocol: 1 or 2.
        max_gap: A beginning older than this, ns, is dropped.
    """

    def __init__(self, protocol: int, max_gap: int = 100_000_000) -> None:
        self._protocol = protocol
        self._max_gap = max_gap
        self._buffer = bytearray()
        self._last = 0
        self._damaged_until = 0  # bytes of the buffer that belong to a packet told as damaged

    @property
    def pending(self) -> int:
        """Number of bytes kept because they may be the beginning of a packet."""
        return len(self._buffer)

    def feed(self, data: bytes, now: int) -> list[Packet | DamagedPacket]:
        """Take bytes in and return the packets they complete. Never raises.

        Args:
            data: Any number of bytes.
            now: Time they arrived, ns.
        """
        if self._buffer and now - self._last > self._max_gap:
            self._drop(len(self._buffer))
        self._last = now
        self._buffer += data
        found: list[Packet | DamagedPacket] = []
        while self._buffer:
            length = packet_length(self._protocol, self._buffer)
            if length < 0:
                following = self._buffer.find(0xFF, 1)
                self._drop(following if following > 0 else len(self._buffer))
                continue
            if length == 0 or len(self._buffer) < length:
                break
            packet = decode_packet(self._protocol, bytes(self._buffer[:length]))
            if packet is not None:
                found.append(packet)
                self._drop(length)
                continue
            if self._damaged_until == 0:
                found.append(DamagedPacket(self._buffer[len(HEADER[self._protocol])]))
                self._damaged_until = length
            self._drop(1)
        return found

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._damaged_until = max(0, self._damaged_until - count)
