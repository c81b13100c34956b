"""Finds packets in a stream of bytes, however it is cut."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final, Generic, TypeVar

P = TypeVar("P")  # a packet
D = TypeVar("D")  # a damaged one

MAX_GAP: Final = 100_000_000
"""Pause, ns, after which a servo forgets the beginning of a packet."""


class StreamParser(ABC, Generic[P, D]):
    """Finds packets in a stream of bytes, however it is cut.

    After a wrong checksum or an impossible length the search goes on right behind the header that
    misled it.

    Args:
        max_gap: A beginning older than this, ns, is dropped.
    """

    def __init__(self, max_gap: int = MAX_GAP) -> None:
        self._buffer = bytearray()
        self._max_gap = max_gap
        self._last = 0
        self._damaged_until = 0  # bytes of the buffer that belong to a reported damaged packet

    @property
    def pending(self) -> int:
        """Number of bytes kept because they may be the beginning of a packet."""
        return len(self._buffer)

    def feed(self, data: bytes, now: int) -> list[P | D]:
        """Take bytes in and return the packets they complete. Never raises.

        Args:
            data: Any number of bytes.
            now: Time they arrived, ns.
        """
        if self._buffer and now - self._last > self._max_gap:
            self._drop(len(self._buffer))
        self._last = now
        self._buffer += data
        found: list[P | D] = []
        while True:
            self._drop(self._noise(self._buffer))
            length = self._packet_length(self._buffer)
            if length == 0 or len(self._buffer) < length:
                return found
            packet = self._decode(bytes(self._buffer[:length]))
            if packet is not None:
                found.append(packet)
                self._drop(length)
                continue
            if self._damaged_until == 0:
                found.append(self._damaged(self._buffer))
                self._damaged_until = length
            self._drop(1)

    @abstractmethod
    def _noise(self, buffer: bytearray) -> int:
        """Return how many bytes at the front cannot begin a packet."""

    @abstractmethod
    def _packet_length(self, buffer: bytearray) -> int:
        """Return the length of the packet at the front, 0 while it is unknown."""

    @abstractmethod
    def _decode(self, packet: bytes) -> P | None:
        """Return the packet, None if it is damaged."""

    @abstractmethod
    def _damaged(self, buffer: bytearray) -> D:
        """Return what is to be told of the damaged packet at the front."""

    def _drop(self, count: int) -> None:
        if count:
            del self._buffer[:count]
            self._damaged_until = max(0, self._damaged_until - count)
