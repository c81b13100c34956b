"""Packets of Dynamixel protocol 1.0 as bytes: what a servo receives and sends.

Layout: FF FF ID LEN INSTRUCTION-or-ERROR PARAMETERS CHECKSUM (ROBOTIS e-manual, protocol 1.0).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

from head_tracking.dynamixel.protocol import BROADCAST_ID, NO_ERROR, ErrorBits, Instruction
from head_tracking.simulation.exceptions import SimulationError
from head_tracking.simulation.stream_parser import StreamParser
from head_tracking.simulation.sync_shares import find_share, join_shares

_HEADER: Final = b"\xff\xff"
_OVERHEAD: Final = 6  # bytes of a packet besides its parameters
_LONGEST: Final = 250  # longest packet the SDK sends


def checksum(body: bytes) -> int:
    """Return the checksum of the bytes from ID to the last parameter."""
    return ~sum(body) & 0xFF


def _frame(servo_id: int, kind: int, parameters: bytes) -> bytes:
    if len(parameters) > _LONGEST - _OVERHEAD:
        raise SimulationError(
            f"{len(parameters)} parameters do not fit into a packet; allowed are "
            f"{_LONGEST - _OVERHEAD}"
        )
    body = bytes((servo_id, len(parameters) + 2, kind)) + parameters
    return _HEADER + body + bytes((checksum(body),))


def _unframe(packet: bytes) -> tuple[int, int, bytes] | None:
    """Return id, instruction or error, and parameters of exactly one whole packet."""
    if len(packet) < _OVERHEAD or packet[:2] != _HEADER or packet[3] + 4 != len(packet):
        return None
    if checksum(packet[2:-1]) != packet[-1]:
        return None
    return packet[2], packet[4], packet[5:-1]


@dataclass(frozen=True, slots=True)
class InstructionPacket:
    """What the master sends.

    Attributes:
        id: The servo, or BROADCAST_ID.
        instruction: Code; see `Instruction`. Unknown codes can occur.
        parameters: Bytes after the code.
    """

    id: int
    instruction: int
    parameters: bytes = b""

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        return _frame(self.id, self.instruction, self.parameters)

    @classmethod
    def decode(cls, packet: bytes) -> Self | None:
        """Return the packet, or None unless the bytes are exactly one; mirrors `encode`."""
        parts = _unframe(packet)
        return None if parts is None else cls(*parts)

    @classmethod
    def ping(cls, servo_id: int) -> Self:
        """Return a ping."""
        return cls(servo_id, Instruction.PING)

    @classmethod
    def read(cls, servo_id: int, address: int, length: int) -> Self:
        """Return a read of `length` bytes."""
        return cls(servo_id, Instruction.READ, bytes((address, length)))

    @classmethod
    def write(cls, servo_id: int, address: int, data: bytes) -> Self:
        """Return a write."""
        return cls(servo_id, Instruction.WRITE, bytes((address,)) + data)

    @classmethod
    def reg_write(cls, servo_id: int, address: int, data: bytes) -> Self:
        """Return a write that waits for `action`."""
        return cls(servo_id, Instruction.REG_WRITE, bytes((address,)) + data)

    @classmethod
    def action(cls, servo_id: int = BROADCAST_ID) -> Self:
        """Return the packet that executes waiting writes."""
        return cls(servo_id, Instruction.ACTION)

    @classmethod
    def factory_reset(cls, servo_id: int) -> Self:
        """Return a factory reset."""
        return cls(servo_id, Instruction.FACTORY_RESET)

    @classmethod
    def sync_write(cls, address: int, data: Mapping[int, bytes]) -> Self:
        """Return one write for several servos; all shares have the same length."""
        length, shares = join_shares(data)
        return cls(BROADCAST_ID, Instruction.SYNC_WRITE, bytes((address, length)) + shares)

    def sync_write_share(self, servo_id: int) -> tuple[int, bytes] | None:
        """Return address and data that a sync write holds for a servo; None if there are none."""
        if len(self.parameters) < 2:
            return None
        address, length = self.parameters[:2]
        share = find_share(self.parameters[2:], length, servo_id)
        return None if share is None else (address, share)

    @classmethod
    def bulk_read(cls, reads: Mapping[int, tuple[int, int]]) -> Self:
        """Return one read of several servos: address and length by id."""
        shares = (
            bytes((length, servo_id, address)) for servo_id, (address, length) in reads.items()
        )
        return cls(BROADCAST_ID, Instruction.BULK_READ, b"\x00" + b"".join(shares))

    def bulk_read_shares(self) -> list[tuple[int, int, int]]:
        """Return id, address and length of each read; none if the packet is malformed."""
        shares = self.parameters[1:]
        if not shares or len(shares) % 3 or self.parameters[0] != 0:
            return []
        return [
            (shares[start + 1], shares[start + 2], shares[start])
            for start in range(0, len(shares), 3)
        ]


@dataclass(frozen=True, slots=True)
class StatusPacket:
    """What a servo answers.

    Attributes:
        id: The servo.
        error: Error bits.
        data: Bytes read.
    """

    id: int
    error: ErrorBits = NO_ERROR
    data: bytes = b""

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        return _frame(self.id, self.error, self.data)

    @classmethod
    def decode(cls, packet: bytes) -> Self | None:
        """Return the packet, or None unless the bytes are exactly one; mirrors `encode`."""
        parts = _unframe(packet)
        return None if parts is None else cls(parts[0], ErrorBits(parts[1]), parts[2])


@dataclass(frozen=True, slots=True)
class DamagedPacket:
    """A packet whose checksum does not fit.

    Attributes:
        id: The servo it seems to be for.
    """

    id: int


class InstructionParser(StreamParser[InstructionPacket, DamagedPacket]):
    """Finds instruction packets in a stream of bytes.

    The stream has no escapes, so FF FF may occur within a packet.
    """

    def _noise(self, buffer: bytearray) -> int:
        start = 0
        while True:
            start = buffer.find(0xFF, start)
            if start < 0:
                return len(buffer)
            rest = len(buffer) - start
            if rest == 1 or (buffer[start + 1] == 0xFF and rest == 2):
                return start
            # A third FF belongs to the next candidate: no servo has the id 255.
            if (
                buffer[start + 1] == 0xFF
                and buffer[start + 2] <= BROADCAST_ID
                and (rest == 3 or 2 <= buffer[start + 3] <= _LONGEST - 4)
            ):
                return start
            start += 1

    def _packet_length(self, buffer: bytearray) -> int:
        return buffer[3] + 4 if len(buffer) > 3 else 0

    def _decode(self, packet: bytes) -> InstructionPacket | None:
        return InstructionPacket.decode(packet)

    def _damaged(self, buffer: bytearray) -> DamagedPacket:
        return DamagedPacket(buffer[2])
