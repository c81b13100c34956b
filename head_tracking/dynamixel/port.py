"""What the bus needs from a serial port. Tests pass a fake; `DynamixelPort` is the real one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.exceptions import CommunicationError


class Reply(NamedTuple):
    """Answer to a read.

    Attributes:
        data: Exactly the bytes that were asked for.
        error: The error byte of the status packet. In protocol 1.0 its bits are the servo's state
            (`ErrorBits`), in protocol 2.0 only the alert bit is; the data are valid all the same.
    """

    data: bytes
    error: int


class ReadMethod(Enum):
    """How the same registers of several servos are read."""

    EACH = "one packet for each"
    BULK = "bulk read"
    SYNC = "sync read"
    FAST_SYNC = "fast sync read"


@dataclass(frozen=True, slots=True)
class ReadGroup:
    """The same registers of one or more servos.

    Attributes:
        method: How they are read.
        protocol: Their protocol, 1 or 2.
        address: First register byte.
        length: Number of bytes.
        ids: The servos.
    """

    method: ReadMethod
    protocol: int
    address: int
    length: int
    ids: tuple[int, ...]


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

    @property
    def adapter(self) -> Adapter:
        """What is known about the device since it was opened."""

    @property
    def is_open(self) -> bool:
        """Whether the port is open; a lost one is not."""

    @property
    def comes_back(self) -> bool:
        """Whether a device that has gone may be found again under its name."""

    def open(self) -> None:
        """Open the port; raises PortError."""

    def close(self) -> None:
        """Close the port; does nothing when it is closed or lost."""

    def ping(self, servo_id: int, protocol: int = 1) -> int:
        """Ask a servo whether it is there; return its error byte."""

    def read(self, servo_id: int, address: int, length: int, protocol: int = 1) -> Reply:
        """Read `length` bytes from `address` on."""

    def read_group(self, group: ReadGroup) -> Iterator[Reply | CommunicationError]:
        """Read from several servos; yield what became of each, in the order of the ids.

        The first question has gone out when this returns, and the next one when an answer is
        handed out: no other method may be used then, except a sync write that is held. After a
        failure nothing is under way.
        """

    def write(
        self,
        servo_id: int,
        address: int,
        data: bytes,
        *,
        acknowledged: bool = True,
        protocol: int = 1,
    ) -> int:
        """Write bytes from `address` on; with `acknowledged` wait for the servo's error byte."""

    def sync_write(
        self, address: int, data: Mapping[int, bytes], protocol: int = 1, *, hold: bool = False
    ) -> None:
        """Write to several servos in one packet, by id; nobody answers.

        With `hold` it waits for the next question, or for `flush`.
        """

    def flush(self) -> None:
        """Send what is held."""

    def reboot(self, servo_id: int) -> None:
        """Restart a protocol 2.0 servo; it answers nothing for a while."""
