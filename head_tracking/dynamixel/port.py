"""What the bus needs from a serial port. Tests pass a fake; `sdk.Protocol1Port` is the real one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from head_tracking.dynamixel.protocol1 import ErrorBits


class Reply(NamedTuple):
    """Answer to a read.

    Attributes:
        data: Exactly the bytes that were asked for.
        error: Error bits of the status packet; the data are valid all the same.
    """

    data: bytes
    error: ErrorBits


class ServoPort(Protocol):
    """A serial port with servos on it. Not thread-safe: one thread owns it.

    Every transaction raises ReplyTimeoutError (no answer in time), CorruptReplyError (an answer
    that cannot be used) or PortLostError (the device has gone).
    """

    @property
    def name(self) -> str:
        """Device, for messages."""

    @property
    def baud_rate(self) -> int:
        """Bits per second."""

    def open(self) -> None:
        """Open the port; raises PortError."""

    def close(self) -> None:
        """Close the port; does nothing when it is closed or lost."""

    def ping(self, servo_id: int) -> ErrorBits:
        """Ask a servo whether it is there."""

    def read(self, servo_id: int, address: int, length: int) -> Reply:
        """Read `length` bytes from `address` on."""

    def write(
        self, servo_id: int, address: int, data: bytes, *, acknowledged: bool = True
    ) -> ErrorBits:
        """Write bytes from `address` on; with `acknowledged` wait for the servo's status."""

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        """Write to several servos in one packet, by id; nobody answers."""
