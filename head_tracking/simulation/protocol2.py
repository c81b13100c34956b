"""Packets of Dynamixel protocol 2.0 as bytes: what a servo receives and sends.

Layout: FF FF FD 00 ID LEN_L LEN_H INSTRUCTION PARAMETERS CRC_L CRC_H; a status has the instruction
55 and an error byte. Each FF FF FD behind LEN is followed by another FD (ROBOTIS e-manual, protocol
2.0).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Self

from head_tracking.dynamixel.protocol import (
    BROADCAST_ID,
    HEADER,
    MAX_ID,
    STATUS,
    Instruction,
    crc16,
    stuff,
    unstuff,
)
from head_tracking.simulation.exceptions import SimulationError
from head_tracking.simulation.stream_parser import StreamParser
from head_tracking.simulation.sync_shares import find_share, join_shares

_OVERHEAD: Final = 10  # bytes of an instruction packet besides its parameters
_LONGEST: Final = 1024  # longest packet the SDK sends


def _frame(servo_id: int, content: bytes) -> bytes:
    content = stuff(content)
    if len(content) > _LONGEST - _OVERHEAD + 1:
        raise SimulationError(
            f"{len(content)} bytes do not fit into a packet; allowed are {_LONGEST - _OVERHEAD + 1}"
        )
    packet = HEADER[2] + bytes((servo_id,)) + (len(content) + 2).to_bytes(2, "little") + content
    return packet + crc16(packet).to_bytes(2, "little")


def _unframe(packet: bytes) -> tuple[int, bytes] | None:
    """Return id and content, unstuffed, of exactly one whole packet."""
    if len(packet) < _OVERHEAD or packet[:4] != HEADER[2]:
        return None
    if int.from_bytes(packet[5:7], "little") + 7 != len(packet):
        return None
    if crc16(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
        return None
    return packet[4], unstuff(packet[7:-2])


def _words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)


@dataclass(frozen=True, slots=True)
class InstructionPacket2:
    """What the master sends.

    Attributes:
        id: The servo, or BROADCAST_ID.
        instruction: Code; see `Instruction`. Unknown codes can occur.
        parameters: Bytes after the code, not stuffed.
    """

    id: int
    instruction: int
    parameters: bytes = b""

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        return _frame(self.id, bytes((self.instruction,)) + self.parameters)

    @classmethod
    def decode(cls, packet: bytes) -> Self | None:
        """Return the packet, or None unless the bytes are exactly one; mirrors `encode`."""
        parts = _unframe(packet)
        return None if parts is None else cls(parts[0], parts[1][0], parts[1][1:])

    @classmethod
    def ping(cls, servo_id: int = BROADCAST_ID) -> Self:
        """Return a ping of one servo, or of all."""
        return cls(servo_id, Instruction.PING)

    @classmethod
    def read(cls, servo_id: int, address: int, length: int) -> Self:
        """Return a read of `length` bytes."""
        return cls(servo_id, Instruction.READ, _words(address, length))

    @classmethod
    def write(cls, servo_id: int, address: int, data: bytes) -> Self:
        """Return a write."""
        return cls(servo_id, Instruction.WRITE, _words(address) + data)

    @classmethod
    def reg_write(cls, servo_id: int, address: int, data: bytes) -> Self:
        """Return a write that waits for `action`."""
        return cls(servo_id, Instruction.REG_WRITE, _words(address) + data)

    @classmethod
    def action(cls, servo_id: int = BROADCAST_ID) -> Self:
        """Return the packet that executes waiting writes."""
        return cls(servo_id, Instruction.ACTION)

    @classmethod
    def reboot(cls, servo_id: int) -> Self:
        """Return a restart."""
        return cls(servo_id, Instruction.REBOOT)

    @classmethod
    def sync_read(
        cls, address: int, length: int, ids: Sequence[int], *, fast: bool = False
    ) -> Self:
        """Return one read of the same registers of several servos."""
        code = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
        return cls(BROADCAST_ID, code, _words(address, length) + bytes(ids))

    @classmethod
    def bulk_read(cls, reads: Mapping[int, tuple[int, int]], *, fast: bool = False) -> Self:
        """Return one read of several servos: address and length by id."""
        code = Instruction.FAST_BULK_READ if fast else Instruction.BULK_READ
        shares = (bytes((servo_id,)) + _words(*place) for servo_id, place in reads.items())
        return cls(BROADCAST_ID, code, b"".join(shares))

    @classmethod
    def sync_write(cls, address: int, data: Mapping[int, bytes]) -> Self:
        """Return one write for several servos; all shares have the same length."""
        length, shares = join_shares(data)
        return cls(BROADCAST_ID, Instruction.SYNC_WRITE, _words(address, length) + shares)

    @classmethod
    def bulk_write(cls, writes: Mapping[int, tuple[int, bytes]]) -> Self:
        """Return one write for several servos: address and data by id."""
        shares = (
            bytes((servo_id,)) + _words(address, len(data)) + data
            for servo_id, (address, data) in writes.items()
        )
        return cls(BROADCAST_ID, Instruction.BULK_WRITE, b"".join(shares))

    def sync_share(self, servo_id: int) -> tuple[int, bytes] | None:
        """Return address and data that a sync write holds for a servo; None if there are none."""
        address, length = self._words_at(0), self._words_at(2)
        share = find_share(self.parameters[4:], length, servo_id)
        return None if share is None else (address, share)

    def bulk_share(self, servo_id: int) -> tuple[int, bytes] | None:
        """Return address and data that a bulk write holds for a servo; None if there are none."""
        start = 0
        while start + 5 < len(self.parameters):
            address, length = self._words_at(start + 1), self._words_at(start + 3)
            end = start + 5 + length
            if end > len(self.parameters):
                return None
            if self.parameters[start] == servo_id:
                return address, self.parameters[start + 5 : end]
            start = end
        return None

    def reads(self) -> list[tuple[int, int, int]]:
        """Return id, address and length of each read of a sync or bulk read; none if malformed."""
        parameters = self.parameters
        if self.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
            address, length = self._words_at(0), self._words_at(2)
            return [(servo_id, address, length) for servo_id in parameters[4:]]
        if len(parameters) % 5:
            return []
        return [
            (parameters[start], self._words_at(start + 1), self._words_at(start + 3))
            for start in range(0, len(parameters), 5)
        ]

    def _words_at(self, start: int) -> int:
        return int.from_bytes(self.parameters[start : start + 2], "little")


@dataclass(frozen=True, slots=True)
class StatusPacket2:
    """What a servo answers.

    Attributes:
        id: The servo.
        error: Alert bit and code.
        data: Bytes read, not stuffed.
    """

    id: int
    error: int = 0
    data: bytes = b""

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        return _frame(self.id, bytes((STATUS, self.error)) + self.data)

    @classmethod
    def decode(cls, packet: bytes) -> Self | None:
        """Return the packet, or None unless the bytes are exactly one; mirrors `encode`."""
        parts = _unframe(packet)
        if parts is None or parts[1][0] != STATUS or len(parts[1]) < 2:
            return None
        return cls(parts[0], parts[1][1], parts[1][2:])


def joint_status(shares: Sequence[StatusPacket2], lengths: Sequence[int]) -> bytes:
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


@dataclass(frozen=True, slots=True)
class DamagedPacket2:
    """A packet whose CRC does not fit.

    Attributes:
        id: The servo it seems to be for.
    """

    id: int


class InstructionParser2(StreamParser[InstructionPacket2, DamagedPacket2]):
    """Finds instruction packets in a stream of bytes."""

    def _noise(self, buffer: bytearray) -> int:
        start = 0
        while True:
            start = buffer.find(0xFF, start)
            if start < 0:
                return len(buffer)
            begin = buffer[start : start + 7]
            if HEADER[2].startswith(begin[:4]) and (len(begin) < 5 or _is_address(begin)):
                return start
            start += 1

    def _packet_length(self, buffer: bytearray) -> int:
        return (buffer[5] | buffer[6] << 8) + 7 if len(buffer) > 6 else 0

    def _decode(self, packet: bytes) -> InstructionPacket2 | None:
        return InstructionPacket2.decode(packet)

    def _damaged(self, buffer: bytearray) -> DamagedPacket2:
        return DamagedPacket2(buffer[4])


def _is_address(begin: bytearray) -> bool:
    """Return whether a header is followed by a possible id and, if it is there, length."""
    if begin[4] > MAX_ID[2] and begin[4] != BROADCAST_ID:
        return False
    return len(begin) < 7 or 3 <= begin[5] | begin[6] << 8 <= _LONGEST - 7
