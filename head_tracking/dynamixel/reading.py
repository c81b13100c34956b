"""Reads: what is asked of one servo or several, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

from head_tracking.dynamixel.protocol import (
    BROADCAST_ID,
    OVERHEAD,
    bulk_read_packet,
    joint_status_size,
    read_packet,
    status_prefix,
    sync_read_packet,
)


class Reply(NamedTuple):
    """What a servo replied to a read.

    Attributes:
        data: Exactly the bytes that were asked for.
        error: The error byte of the status packet. In protocol 1.0 its bits are the servo's state
            (`ErrorBits`), in protocol 2.0 only the alert bit is; the data are valid all the same.
        stamp: When the servo had received the request, on the port's clock, s.
    """

    data: bytes
    error: int
    stamp: float = 0.0


class ReadMethod(Enum):
    """How the same registers of several servos are read."""

    EACH = "a packet for each"
    BULK = "bulk read"
    SYNC = "sync read"
    FAST_SYNC = "fast sync read"


class Request(NamedTuple):
    """A packet that is sent, and the reply of one servo that is expected.

    Attributes:
        packet: What is sent.
        protocol: 1 or 2.
        id: The servo; BROADCAST_ID if several reply in one packet.
        length: Bytes of data of the reply.
        size: Bytes of the reply.
        prefix: First bytes of the reply.
        what: What is asked for, for messages.
    """

    packet: bytes
    protocol: int
    id: int
    length: int
    size: int
    prefix: bytes
    what: str


def request_for(packet: bytes, protocol: int, servo_id: int, length: int, what: str) -> Request:
    """Return a request whose reply has so many bytes of data."""
    prefix = status_prefix(protocol, servo_id, length)
    return Request(packet, protocol, servo_id, length, OVERHEAD[protocol] + length, prefix, what)


Plausible = Callable[[bytes], bool]


@dataclass(frozen=True, slots=True)
class ReadGroup:
    """The same registers of one or more servos, read with one packet.

    Attributes:
        method: How they are read; EACH for one servo only.
        protocol: Their protocol, 1 or 2.
        address: First register byte.
        length: Number of bytes.
        ids: The servos.
        plausible: Returns whether a servo can have sent these bytes. The checksum of protocol 1.0
            is weak: two damaged bits can cancel each other out.
        requests: The replies to the packet that reads all of them.
    """

    method: ReadMethod
    protocol: int
    address: int
    length: int
    ids: tuple[int, ...]
    plausible: Plausible | None = None
    requests: tuple[Request, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        protocol, address, length, ids = self.protocol, self.address, self.length, self.ids
        size, senders = length, ids
        if len(ids) == 1:
            packet = read_packet(protocol, ids[0], address, length)
        elif self.method is ReadMethod.BULK:
            packet = bulk_read_packet(ids, address, length)
        elif self.method is ReadMethod.SYNC:
            packet = sync_read_packet(protocol, ids, address, length)
        else:
            packet = sync_read_packet(2, ids, address, length, fast=True)
            size, senders = joint_status_size(len(ids), length), (BROADCAST_ID,)
        what = f"read of {length} byte(s) at {address}"
        requests = [request_for(packet, protocol, sender, size, what) for sender in senders]
        object.__setattr__(self, "requests", tuple(requests))

    def longer(self, extra: int) -> ReadGroup:
        """Return the group that reads some bytes more, before its own where there are as many."""
        first = self.address - extra if self.address >= extra else self.address
        return ReadGroup(self.method, self.protocol, first, self.length + extra, self.ids)


single_read_group = lru_cache(maxsize=512)(ReadGroup)
