"""Reads: what is asked of one servo or several, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

from head_tracking.dynamixel.exceptions import CommunicationError
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
        causes: Why there was no usable reply before, once for each try.
    """

    data: bytes
    error: int
    stamp: float = 0.0
    causes: tuple[CommunicationError, ...] = ()


class Failed(NamedTuple):
    """A read that failed, each time it was tried.

    Attributes:
        causes: Why, once for each try.
    """

    causes: tuple[CommunicationError, ...]


class ReadMethod(Enum):
    """How the same registers of several servos are read."""

    EACH = "one packet for each"
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
    """The same registers of one or more servos.

    Attributes:
        method: How they are read.
        protocol: Their protocol, 1 or 2.
        address: First register byte.
        length: Number of bytes.
        ids: The servos.
        plausible: Returns whether a servo can have sent these bytes. The checksum of protocol 1.0
            is weak: two damaged bits can cancel each other out.
        requests: The replies to the packet that reads all of them; none if each is asked alone.
        alone: The groups that read each servo alone.
    """

    method: ReadMethod
    protocol: int
    address: int
    length: int
    ids: tuple[int, ...]
    plausible: Plausible | None = None
    requests: tuple[Request, ...] = field(init=False, repr=False, compare=False)
    alone: tuple[ReadGroup, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        alone = [self]
        if len(self.ids) > 1:
            alone = [replace(self, method=ReadMethod.EACH, ids=(each,)) for each in self.ids]
        object.__setattr__(self, "alone", tuple(alone))
        object.__setattr__(self, "requests", tuple(self._requests(self.ids)))

    def _requests(self, ids: tuple[int, ...]) -> Iterator[Request]:
        protocol, address, length, method = self.protocol, self.address, self.length, self.method
        what = f"read of {length} byte(s) at {address}"
        if len(ids) == 1:
            for servo_id in ids:
                packet = read_packet(protocol, servo_id, address, length)
                yield request_for(packet, protocol, servo_id, length, what)
        elif method is ReadMethod.FAST_SYNC:
            packet = sync_read_packet(2, ids, address, length, fast=True)
            yield request_for(packet, 2, BROADCAST_ID, joint_status_size(len(ids), length), what)
        elif method is not ReadMethod.EACH:
            if method is ReadMethod.BULK:
                packet = bulk_read_packet(ids, address, length)
            else:
                packet = sync_read_packet(protocol, ids, address, length)
            for servo_id in ids:
                yield request_for(packet, protocol, servo_id, length, what)

    def longer(self, extra: int) -> ReadGroup:
        """Return the group that reads some bytes more, before its own where there are as many."""
        first = self.address - extra if self.address >= extra else self.address
        return ReadGroup(self.method, self.protocol, first, self.length + extra, self.ids)


single_read_group = lru_cache(maxsize=512)(ReadGroup)
