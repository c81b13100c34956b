"""The serial device, opened with pyserial: bytes in and out, and why it cannot be opened.

dynamixel_sdk's own port does not do: its reading spins while it waits, on a clock that can jump,
with 34 ms of patience; it takes echoes and late replies for replies, and an error without data is
an IndexError (3.8.4 to 4.1.0, whose Python port handler is that of 4.0.5).
"""

from __future__ import annotations

import errno
import grp
import math
import os
import select
import termios
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import serial
from serial.tools import list_ports

from head_tracking.dynamixel.adapter import Adapter, prepare_adapter
from head_tracking.dynamixel.exceptions import (
    ConfigurationError,
    PortBusyError,
    PortError,
    PortMissingError,
    PortPermissionError,
)

_SELECTABLE: Final = 1024  # select knows no higher descriptor
BAUD_RATES: Final = (
    9_600, 19_200, 38_400, 57_600, 115_200, 200_000, 230_400, 250_000, 400_000, 460_800, 500_000,
    576_000, 921_600, 1_000_000, 1_152_000, 2_000_000, 2_250_000, 2_500_000, 3_000_000, 3_500_000,
    4_000_000, 4_500_000,
)  # fmt: skip
"""Bits per second that Dynamixel servos know, and those that serial adapters usually do."""


class SerialLine:
    """An open, non-blocking serial device. Times are those of `time.monotonic`, in s.

    Args:
        descriptor: The device, opened and closed by the caller.

    All methods raise OSError or termios.error when the device has gone.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._writable = select.poll()
        self._writable.register(descriptor, select.POLLOUT)
        self._readable = select.poll()
        self._readable.register(descriptor, select.POLLIN)

    def discard_input(self) -> None:
        """Forget everything received so far."""
        termios.tcflush(self._descriptor, termios.TCIFLUSH)

    def write(self, data: bytes, timeout: float) -> None:
        """Write all bytes.

        Raises:
            TimeoutError: The device took no more data for `timeout` seconds.
        """
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

        Bytes that have arrived count even if this thread runs only after the deadline.
        """
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
        """Return whether there is something to read within the last fraction of a millisecond.

        poll, which is faster, counts whole milliseconds.
        """
        rest = max(0.0, deadline - time.monotonic())
        if self._descriptor >= _SELECTABLE:
            return bool(self._readable.poll(math.ceil(rest * 1e3)))
        return bool(select.select((self._descriptor,), (), (), rest)[0])


class SerialDevice:
    """An open serial device.

    Args:
        port_name: Device, such as /dev/ttyUSB0.
        baud_rate: Bits per second.

    Attributes:
        line: Bytes in and out.
        adapter: What is known about it.

    Raises:
        PortMissingError: There is no such device.
        PortBusyError: Another program holds it.
        PortPermissionError: The user may not open it.
        PortError: It is no serial port, cannot do the baud rate, or fails for another reason.
    """

    def __init__(self, port_name: str, baud_rate: int) -> None:
        self._serial = serial.Serial(baudrate=baud_rate, timeout=0, exclusive=True)
        self._serial.port = port_name
        try:
            self._serial.open()
            self.adapter: Adapter = prepare_adapter(
                port_name, lambda: self._serial.set_low_latency_mode(True)
            )
            self.line = SerialLine(self._serial.fileno())
            self.line.discard_input()
        except (OSError, ValueError, termios.error) as cause:
            self.close()
            raise port_error(port_name, cause) from cause

    def close(self) -> None:
        """Close the device, also one that has gone."""
        with suppress(OSError, termios.error):
            self._serial.close()


def check_baud_rate(baud_rate: int) -> None:
    """Refuse baud rates that no servo knows.

    Raises:
        ConfigurationError: It is none of BAUD_RATES.
    """
    if baud_rate not in BAUD_RATES:
        raise ConfigurationError(
            f"no servo knows {baud_rate} baud; allowed are "
            f"{', '.join(str(rate) for rate in BAUD_RATES)}"
        )


def serial_ports() -> tuple[str, ...]:
    """Return the serial devices of this machine."""
    return tuple(sorted(port.device for port in list_ports.comports()))


def port_error(port_name: str, cause: Exception) -> PortError:
    """Return the error to raise.

    Args:
        port_name: The device that was to be opened.
        cause: The operating system's error; its first argument is the error number. Or pyserial's
            ValueError, of a device that does not know the baud rate.
    """
    if isinstance(cause, ValueError):
        return PortError(port_name, f"it cannot do this baud rate: {cause}")
    number = cause.args[0] if cause.args else None
    if number == errno.ENOENT:
        return PortMissingError(port_name)
    if number in (errno.EBUSY, errno.EAGAIN):
        return PortBusyError(port_name)
    if number in (errno.EACCES, errno.EPERM) and not Path(port_name).is_file():
        return PortPermissionError(port_name, _group_of(port_name))
    return PortError(port_name, f"{cause}; it must be a serial device")


def _group_of(port_name: str) -> str:
    try:
        return grp.getgrgid(os.stat(port_name).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
