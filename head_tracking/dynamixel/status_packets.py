"""Finds the status packets in what came from the wire.

The SDK's own reading is not used: it takes the echo of an instruction for its answer, waits for
the end of packets that only look like packets, and damages some stuffed ones.
"""

from __future__ import annotations

from typing import Final, NamedTuple, Protocol

from head_tracking.dynamixel.protocol1 import MAX_ID as MAX_ID_1
from head_tracking.dynamixel.protocol2 import BROADCAST_ID, HEADER, STATUS, crc16, unstuff
from head_tracking.dynamixel.protocol2 import MAX_ID as MAX_ID_2


class Status(NamedTuple):
    """A status packet whose checksum fits.

    Attributes:
        id: The servo.
        error: Its error byte.
        data: What it carries.
    """

    id: int
    error: int
    data: bytes


class Found(NamedTuple):
    """What a buffer holds.

    Attributes:
        status: The first status packet; None if there is none (yet).
        packet: Its bytes.
        end: Where it ends in the buffer.
        damaged: Whether there is a whole packet with a wrong checksum before it, or at all.
    """

    status: Status | None
    packet: bytes
    end: int
    damaged: bool


class Dialect(Protocol):
    """How status packets look in one protocol."""

    number: int
    overhead: int
    """Bytes of a status packet besides its data."""

    def whole(self, data: bytes, servo_id: int) -> Status | None:
        """Return the status packet of a servo if the bytes are exactly that; the usual case."""

    def find(self, buffer: bytes | bytearray) -> Found:
        """Return the first status packet in a buffer, whatever stands before it.

        What only seems to begin a packet, because noise looks like a header, does not hide the
        packets behind it.
        """


class Dialect1:
    """Protocol 1.0: FF FF ID LEN ERROR DATA CHECKSUM."""

    number: int = 1
    overhead: int = 6

    def whole(self, data: bytes, servo_id: int) -> Status | None:
        """See `Dialect.whole`."""
        if (
            data[2] == servo_id
            and data[0] == 0xFF == data[1]
            and data[3] == len(data) - 4
            and data[4] <= 0x7F
            and sum(data) & 0xFF == 0xFD  # twice FF, and a checksum that makes the rest FF
        ):
            return Status(servo_id, data[4], data[5:-1])
        return None

    def find(self, buffer: bytes | bytearray) -> Found:
        """See `Dialect.find`. The echo of an instruction looks like a status packet here."""
        damaged = False
        start = 0
        while True:
            start = buffer.find(b"\xff\xff", start)
            if start < 0 or start + 5 > len(buffer):
                return Found(None, b"", 0, damaged)
            length = buffer[start + 3]
            end = start + length + 4
            if buffer[start + 2] > MAX_ID_1 or length < 2 or buffer[start + 4] > 0x7F:
                start += 1
            elif end > len(buffer):
                start += 1  # it may be the answer, still under way; look on all the same
            elif ~sum(buffer[start + 2 : end - 1]) & 0xFF != buffer[end - 1]:
                damaged = True
                start += 1
            else:
                packet = bytes(buffer[start:end])
                return Found(Status(packet[2], packet[4], packet[5:-1]), packet, end, damaged)


class Dialect2:
    """Protocol 2.0: FF FF FD 00 ID LEN LEN 55 ERROR DATA CRC CRC, with stuffed content."""

    number: int = 2
    overhead: int = 11

    def whole(self, data: bytes, servo_id: int) -> Status | None:
        """See `Dialect.whole`."""
        found = self.find(data)
        status = found.status
        if status is not None and found.end == len(data) and status.id == servo_id:
            return status
        return None

    def find(self, buffer: bytes | bytearray) -> Found:
        """See `Dialect.find`."""
        damaged = False
        start = 0
        while True:
            start = buffer.find(HEADER, start)
            if start < 0 or start + 9 > len(buffer):
                return Found(None, b"", 0, damaged)
            servo_id = buffer[start + 4]
            length = buffer[start + 5] | buffer[start + 6] << 8
            end = start + length + 7
            if (
                (servo_id > MAX_ID_2 and servo_id != BROADCAST_ID)
                or length < 4
                or buffer[start + 7] != STATUS
                or end > len(buffer)
            ):
                start += 1
                continue
            packet = bytes(buffer[start:end])
            if crc16(packet[:-2]) != packet[-2] | packet[-1] << 8:
                damaged = True
                start += 1
                continue
            if servo_id == BROADCAST_ID:  # a fast sync read's, which is not stuffed
                return Found(Status(servo_id, packet[8], packet[9:-2]), packet, end, damaged)
            content = unstuff(packet[8:-2])
            return Found(Status(servo_id, content[0], content[1:]), packet, end, damaged)


def split_fast_status(packet: Status, length: int, count: int) -> list[Status]:
    """Return what each servo said in the joint answer to a fast sync read; [] if it is odd.

    Each share is ERROR ID DATA and a CRC of the joint packet so far; the last one's is the packet's
    own and has been checked.

    Args:
        packet: The joint answer; its error byte is the first servo's.
        length: Bytes of data of each servo.
        count: Number of servos.
    """
    content = bytes((packet.error,)) + packet.data
    size = length + 4
    if len(content) != size * count - 2:
        return []
    shares = [content[start : start + size] for start in range(0, len(content), size)]
    return [Status(share[1], share[0], share[2 : 2 + length]) for share in shares]


DIALECTS: Final[dict[int, Dialect]] = {1: Dialect1(), 2: Dialect2()}
