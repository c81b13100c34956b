"""Bytes in and out of an open serial device, waiting in poll instead of spinning."""

from __future__ import annotations

import errno
import os
import select
import termios
import time
from typing import Final

_BABBLE: Final = 256
_SELECTABLE: Final = 1024  # select knows no higher descriptor


class SerialLine:
    """An open, non-blocking serial device. Times are those of `time.monotonic`, in s.

    Args:
        descriptor: The device, opened by somebody else who also closes it.

    All methods raise OSError or termios.error when the device has gone.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._readable = select.poll()
        self._readable.register(descriptor, select.POLLIN)
        self._writable = select.poll()
        self._writable.register(descriptor, select.POLLOUT)
        self._overtime = 0

    def discard_input(self) -> None:
        """Forget everything received so far."""
        termios.tcflush(self._descriptor, termios.TCIFLUSH)

    def write(self, data: bytes, timeout: float) -> None:
        """Write all bytes.

        Raises:
            TimeoutError: The device took no more data for `timeout` seconds.
        """
        self._overtime = _BABBLE
        try:
            written = os.write(self._descriptor, data)
        except BlockingIOError:
            written = 0
        while written < len(data):
            try:
                written += os.write(self._descriptor, data[written:])
            except BlockingIOError:
                if not self._writable.poll(timeout * 1e3):
                    raise TimeoutError(
                        errno.ETIMEDOUT, f"it took no data for {timeout:.2f} s"
                    ) from None

    def read(self, limit: int, deadline: float) -> bytes:
        """Return at most `limit` bytes, waiting for the first one until the deadline.

        Bytes that arrived in time count even when this thread runs only after the deadline; but
        endless babble does not keep it here for ever: so many bytes after each write at most.
        """
        patience = deadline - time.monotonic()
        if patience <= 0.0 and self._overtime <= 0:
            return b""
        if not self._readable.poll(int(patience * 1e3) if patience > 0.0 else 0) and (
            patience <= 0.0 or not self._wait(deadline - time.monotonic())
        ):
            return b""
        try:
            data = os.read(self._descriptor, limit)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError(errno.EIO, "the device has gone")
        if patience <= 0.0:
            self._overtime -= len(data)
        return data

    def _wait(self, rest: float) -> bool:
        """Return whether there is something to read within the last fraction of a millisecond.

        poll counts whole milliseconds. What is left of the time is for select, so that silence
        costs no more than it has to.
        """
        if self._descriptor >= _SELECTABLE:
            return bool(self._readable.poll(1))
        return bool(select.select((self._descriptor,), (), (), max(0.0, rest))[0])
