"""What a conversation needs from an open serial device."""

from __future__ import annotations

from typing import Protocol


class Line(Protocol):
    """Bytes in and out; `SerialLine` is the real one."""

    def discard_input(self) -> None:
        """Forget everything received so far."""

    def write(self, data: bytes, timeout: float) -> None:
        """Write all bytes, within `timeout` s."""

    def read(self, limit: int, deadline: float) -> bytes:
        """Return some bytes, or none when the deadline, s, has passed."""
