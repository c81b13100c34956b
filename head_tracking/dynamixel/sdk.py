"""ROBOTIS' dynamixel_sdk and pyserial: the one file that knows them.

The SDK opens the device and builds the instruction packets. It does not read: it spins while it
waits, on a clock that can jump, with 34 ms of patience; it takes echoes and late answers for
answers, and an error without data is an IndexError. See `Conversation` for reading.

Works with dynamixel_sdk 3.8.4 (ROS 2 Jazzy) and 4.1.0.
"""

from __future__ import annotations

import termios
from contextlib import suppress
from typing import Final

import serial
from dynamixel_sdk import PortHandler
from serial.tools import list_ports

from head_tracking.dynamixel.adapter import Adapter, prepare_adapter
from head_tracking.dynamixel.exceptions import ConfigurationError
from head_tracking.dynamixel.port_diagnosis import port_error
from head_tracking.dynamixel.serial_line import SerialLine

_USUAL_BAUD_RATES: Final = (
    9_600, 19_200, 38_400, 57_600, 115_200, 200_000, 230_400, 250_000, 400_000, 460_800, 500_000,
    576_000, 921_600, 1_000_000, 1_152_000, 2_000_000, 2_250_000, 2_500_000, 3_000_000, 3_500_000,
    4_000_000, 4_500_000,
)  # fmt: skip


class _LockingPortHandler(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's port handler, on a device that no second program may open."""

    def setupPort(self, cflag_baud: int) -> bool:
        self.ser = serial.Serial(
            port=self.port_name, baudrate=self.baudrate, timeout=0, exclusive=True
        )
        self.is_open = True
        return True


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
        self._handler = _LockingPortHandler(port_name)
        self._handler.baudrate = baud_rate
        try:
            self._handler.openPort()
            descriptor = self._handler.ser.fileno()
            self.adapter: Adapter = prepare_adapter(port_name, descriptor)
            self.line = SerialLine(descriptor)
            self.line.discard_input()
        except (OSError, ValueError, termios.error) as cause:
            if self._handler.is_open:
                self.close()
            raise port_error(port_name, cause, serial_ports()) from cause

    def close(self) -> None:
        """Close the device, also one that has gone."""
        with suppress(OSError, termios.error):
            self._handler.closePort()


def check_baud_rate(baud_rate: int) -> None:
    """Refuse baud rates that the SDK cannot set.

    Raises:
        ConfigurationError: It cannot; says which it can.
    """
    handler = PortHandler("")
    if handler.getCFlagBaud(baud_rate) <= 0:
        allowed = [rate for rate in _USUAL_BAUD_RATES if handler.getCFlagBaud(rate) > 0]
        raise ConfigurationError(
            f"dynamixel_sdk cannot set {baud_rate} baud; allowed are "
            f"{', '.join(str(rate) for rate in allowed)}"
        )


def serial_ports() -> tuple[str, ...]:
    """Return the serial devices of this machine."""
    return tuple(sorted(port.device for port in list_ports.comports()))
