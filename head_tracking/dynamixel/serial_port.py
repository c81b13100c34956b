"""The serial device, opened with pyserial.

dynamixel_sdk's port handler is not used (3.8.4 to 4.1.0): it polls without a pause, on a clock that
can jump, for at least 34 ms; it accepts echoes and late replies as replies.
"""

from __future__ import annotations

import errno
import math
import os
import select
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import serial
from serial.tools import list_ports

from head_tracking.dynamixel.adapter import Adapter, prepare_adapter
from head_tracking.dynamixel.exceptions import (
    BaudRateError,
    ConfigurationError,
    PortBusyError,
    PortError,
    PortMissingError,
    PortPermissionError,
)

try:
    from termios import error as TerminalError
except ImportError:  # Windows
    TerminalError = OSError  # type: ignore[assignment,misc]

LOST: Final = (OSError, TerminalError)
"""What a device raises that has been unplugged."""

_WRITE_TIMEOUT: Final = 0.1  # s
_POLL: Final = 0.0002  # s
_SELECTABLE: Final = 1024  # select() accepts lower descriptors only
BAUD_RATES: Final = (
    9_600, 19_200, 38_400, 57_600, 115_200, 200_000, 230_400, 250_000, 400_000, 460_800, 500_000,
    576_000, 921_600, 1_000_000, 1_152_000, 2_000_000, 2_250_000, 2_500_000, 3_000_000, 3_500_000,
    4_000_000, 4_500_000,
)  # fmt: skip
"""Bits per second that servos or serial adapters support."""


class SerialDevice:
    """An open serial device of any system. Times are those of `time.monotonic`, in s.

    All methods raise one of `LOST` when the device has been unplugged.

    Args:
        port_name: Device, such as /dev/ttyUSB0 or COM3.
        baud_rate: Bits per second.

    Attributes:
        adapter: Facts about it.

    Raises:
        PortError: The device cannot be opened; see `port_error`.
    """

    def __init__(self, port_name: str, baud_rate: int) -> None:
        self._serial = serial.Serial(
            baudrate=baud_rate, timeout=0, write_timeout=_WRITE_TIMEOUT, exclusive=True
        )
        self._serial.port = port_name
        try:
            self._serial.open()
            self.adapter = self._prepare()
            self.discard_input()
        except (ValueError, *LOST) as cause:
            self.close()
            raise port_error(port_name, cause) from cause

    def _prepare(self) -> Adapter:
        return Adapter()

    def discard_input(self) -> None:
        """Discard the bytes received so far."""
        self._serial.reset_input_buffer()

    def write(self, data: bytes) -> None:
        """Write all bytes.

        Raises:
            OSError: The device accepted no data for 0.1 s.
        """
        self._serial.write(data)

    def read(self, limit: int, deadline: float) -> bytes:
        """Return up to `limit` bytes; wait for the first one until the deadline, s.

        Bytes that have arrived are returned even if this thread runs only after the deadline.
        """
        # a new timeout of pyserial would configure the adapter anew, which takes long on Windows
        while not (arrived := self._serial.in_waiting) and time.monotonic() < deadline:
            time.sleep(_POLL)
        data: bytes = self._serial.read(min(limit, arrived))
        return data

    def close(self) -> None:
        """Close the device, also one that has been unplugged."""
        with suppress(*LOST):
            self._serial.close()


class LinuxDevice(SerialDevice):
    """A serial device of Linux, by its system calls: pyserial needs five times as long."""

    def _prepare(self) -> Adapter:
        self._descriptor: int = self._serial.fileno()
        self._writable, self._readable = select.poll(), select.poll()
        self._writable.register(self._descriptor, select.POLLOUT)
        self._readable.register(self._descriptor, select.POLLIN)
        return prepare_adapter(self._serial.port, lambda: self._serial.set_low_latency_mode(True))

    def write(self, data: bytes) -> None:
        """See `SerialDevice`."""
        try:
            written = os.write(self._descriptor, data)
        except BlockingIOError:
            written = 0
        while written < len(data):
            try:
                written += os.write(self._descriptor, data[written:])
            except BlockingIOError:
                if not self._writable.poll(_WRITE_TIMEOUT * 1e3):
                    raise TimeoutError(
                        errno.ETIMEDOUT, f"it accepted no data for {_WRITE_TIMEOUT} s"
                    ) from None

    def read(self, limit: int, deadline: float) -> bytes:
        """See `SerialDevice`."""
        wait = (deadline - time.monotonic()) * 1e3
        if not self._readable.poll(int(wait) if wait > 0.0 else 0) and (
            wait <= 0.0 or not self._wait(deadline)
        ):
            return b""
        try:
            data = os.read(self._descriptor, limit)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError(errno.EIO, "the device has gone")
        return data

    def _wait(self, deadline: float) -> bool:
        """Wait for the last fraction of a millisecond: poll(), which is faster, counts whole ms."""
        rest = max(0.0, deadline - time.monotonic())
        if self._descriptor >= _SELECTABLE:
            return bool(self._readable.poll(math.ceil(rest * 1e3)))
        return bool(select.select((self._descriptor,), (), (), rest)[0])


def open_serial(port_name: str, baud_rate: int) -> SerialDevice:
    """Open a device in the best way that this system has."""
    return (LinuxDevice if sys.platform == "linux" else SerialDevice)(port_name, baud_rate)


def check_baud_rate(baud_rate: int) -> None:
    """Raise ConfigurationError for a rate that is none of BAUD_RATES."""
    if baud_rate not in BAUD_RATES:
        raise ConfigurationError(
            f"no servo supports {baud_rate} baud; allowed are {', '.join(map(str, BAUD_RATES))}"
        )


def serial_ports() -> tuple[str, ...]:
    """Return the serial devices of this machine."""
    return tuple(sorted(port.device for port in list_ports.comports()))


def port_error(port_name: str, cause: Exception) -> PortError:
    """Return the error for a device that could not be opened.

    The cause is an OSError, or pyserial's ValueError for an unsupported baud rate.
    """
    if isinstance(cause, ValueError):
        return BaudRateError(port_name, f"it does not support this baud rate: {cause}")
    number = cause.args[0] if cause.args else None
    if number == errno.ENOENT:
        return PortMissingError(port_name)
    if number in (errno.EBUSY, errno.EAGAIN):
        return PortBusyError(port_name)
    if number in (errno.EACCES, errno.EPERM) and not Path(port_name).is_file():
        try:
            group = Path(port_name).group()
        except (OSError, KeyError):
            group = "dialout"
        return PortPermissionError(port_name, group)
    return PortError(port_name, f"{cause}; it must be a serial device")
