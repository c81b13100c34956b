"""Bytes in and out of an open serial device, waiting in poll instead of spinning."""

from __future__ import annotations

import errno
import os
import select
import termios
import time
from typing import Final

_CHUNK: Final = 256


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
        self._received = bytearray()
        self._overtime = 0

    def discard_input(self) -> None:
        """Forget everything received so far, and give the next reply its full time."""
        self._received.clear()
        self._overtime = _CHUNK
        termios.tcflush(self._descriptor, termios.TCIFLUSH)

    def write(self, data: bytes, timeout: float) -> None:
        """Write all bytes.

        Raises:
            TimeoutError: The device took no more data for `timeout` seconds.
        """
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
        endless babble does not keep it here for ever.
        """
        if len(self._received) < limit:
            self._receive(deadline - time.monotonic())
        data = bytes(self._received[:limit])
        del self._received[:limit]
        return data

    def _receive(self, patience: float) -> None:
        if patience <= 0.0 and self._overtime <= 0:
            return
        if not self._readable.poll(max(0.0, patience * 1e3)):
            return
        try:
            data = os.read(self._descriptor, _CHUNK)
        except BlockingIOError:
            return
        if not data:
            raise OSError(errno.EIO, "the device has gone")
        if patience <= 0.0:
            self._overtime -= len(data)
        self._received += data
