"""Instructions that read registers of one servo or several, and the replies they expect."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

from head_tracking.dynamixel.protocol import (
    OVERHEAD,
    bulk_read_packet,
    read_packet,
    status_prefix,
    sync_read_packet,
)


class InstructionPacket(NamedTuple):
    """A packet to send, and the reply of one servo that is expected."""

    packet: bytes
    protocol: int
    id: int  # of the servo
    length: int  # bytes of data of the reply
    size: int  # bytes of the reply
    prefix: bytes  # first bytes of the reply
    description: str  # of the instruction, for messages
    behind: tuple[int, ...] = ()  # ids of the servos that reply to the same packet after this one


def instruction_packet(
    packet: bytes, protocol: int, servo_id: int, length: int, description: str
) -> InstructionPacket:
    """Return an instruction whose reply has `length` bytes of data."""
    prefix = status_prefix(protocol, servo_id, length)
    size = OVERHEAD[protocol] + length
    return InstructionPacket(packet, protocol, servo_id, length, size, prefix, description)


@dataclass(frozen=True, slots=True)
class ReadGroup:
    """The same registers of one servo, or of several with a sync or bulk read, in one packet."""

    protocol: int
    address: int  # of the first byte
    length: int  # bytes
    ids: tuple[int, ...]
    bulk: bool = False  # whether several are read with a bulk read
    # the packet, once for the reply of each servo
    replies: tuple[InstructionPacket, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        protocol, address, length, ids = self.protocol, self.address, self.length, self.ids
        if len(ids) == 1:
            packet = read_packet(protocol, ids[0], address, length)
        elif self.bulk:
            packet = bulk_read_packet(ids, address, length)
        else:
            packet = sync_read_packet(protocol, ids, address, length)
        what = f"read of {length} byte(s) at {address}"
        replies = [
            instruction_packet(packet, protocol, each, length, what)._replace(behind=ids[place:])
            for place, each in enumerate(ids, 1)
        ]
        object.__setattr__(self, "replies", tuple(replies))

    def extended(self, extra: int) -> ReadGroup:
        """Return a group that reads `extra` bytes more, before the others where possible."""
        first = self.address - extra if self.address >= extra else self.address
        return ReadGroup(self.protocol, first, self.length + extra, self.ids, self.bulk)


single_read_group = lru_cache(maxsize=512)(ReadGroup)
