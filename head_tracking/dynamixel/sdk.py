"""The serial port, through ROBOTIS' dynamixel_sdk: the one file that knows the SDK and pyserial.

The SDK builds and parses the packets. Its port handler is replaced, because it spins while it
waits, measures time on a clock that can jump, and does not lock the device. Its convenience reads
are not used, because they check neither the length of a reply nor that it has data at all.

Works with dynamixel_sdk 3.8.4 (ROS 2 Jazzy) and 4.1.0.
"""

from __future__ import annotations

import termios
import time
from collections.abc import Callable, Mapping
from typing import Final

import serial
from dynamixel_sdk import (
    COMM_RX_CORRUPT,
    COMM_RX_TIMEOUT,
    COMM_SUCCESS,
    PortHandler,
    Protocol1PacketHandler,
)
from serial.tools import list_ports

from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    DynamixelError,
    NotConnectedError,
    PortLostError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.port import Reply
from head_tracking.dynamixel.port_diagnosis import port_error
from head_tracking.dynamixel.protocol1 import (
    NO_ERROR,
    ErrorBits,
    Instruction,
    describe_errors,
)
from head_tracking.dynamixel.serial_line import SerialLine

_USUAL_BAUD_RATES: Final = (
    9_600, 19_200, 38_400, 57_600, 115_200, 200_000, 230_400, 250_000, 400_000, 460_800, 500_000,
    576_000, 921_600, 1_000_000, 1_152_000, 2_000_000, 2_250_000, 2_500_000, 3_000_000, 3_500_000,
    4_000_000, 4_500_000,
)  # fmt: skip
_OVERHEAD: Final = 6  # bytes of a status packet besides its data


class _WaitingPortHandler(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's port handler, waiting in poll, with a monotonic deadline and a locked device."""

    def __init__(
        self, port_name: str, baud_rate: int, reply_timeout: float, write_timeout: float
    ) -> None:
        super().__init__(port_name)
        self.baudrate = baud_rate
        self._reply_timeout = reply_timeout
        self._write_timeout = write_timeout
        self._seconds_per_byte = 10.0 / baud_rate
        self._deadline = 0.0
        self._sent = 0

    def setupPort(self, cflag_baud: int) -> bool:
        self.ser = serial.Serial(
            port=self.port_name, baudrate=self.baudrate, timeout=0, exclusive=True
        )
        self.is_open = True
        self._line = SerialLine(self.ser.fileno())
        self._line.discard_input()
        return True

    def clearPort(self) -> None:
        self._line.discard_input()

    def writePort(self, packet: list[int]) -> int:
        self._line.write(bytes(packet), self._write_timeout)
        self._sent = len(packet)
        return self._sent

    def setPacketTimeout(self, packet_length: int) -> None:
        wire = (self._sent + packet_length) * self._seconds_per_byte
        self._deadline = time.monotonic() + wire + self._reply_timeout

    def isPacketTimeout(self) -> bool:
        return time.monotonic() >= self._deadline

    def readPort(self, length: int) -> bytes:
        # The SDK asks for a negative number of bytes after a packet with an absurd length.
        return self._line.read(length, self._deadline) if length > 0 else b""


_Transmit = Callable[[_WaitingPortHandler], int]


class Protocol1Port:
    """A serial port with protocol 1.0 servos; implements `ServoPort`.

    Args:
        port_name: Device, such as /dev/ttyUSB0.
        baud_rate: Bits per second; AX servos leave the factory with 1000000.
        reply_timeout: Time a servo may take to answer, s, added to the time on the wire. The
            default leaves room for an FTDI adapter's 16 ms latency timer.
        write_timeout: Time the device may refuse to take data, s.

    Raises:
        ConfigurationError: The SDK cannot set this baud rate, or a timeout is not above 0.
    """

    def __init__(
        self,
        port_name: str,
        baud_rate: int = 1_000_000,
        *,
        reply_timeout: float = 0.025,
        write_timeout: float = 0.1,
    ) -> None:
        _check_baud_rate(baud_rate)
        for name, value in (("reply_timeout", reply_timeout), ("write_timeout", write_timeout)):
            if not 0.0 < value < 10.0:
                raise ConfigurationError(f"{name} is {value}; allowed are 0 to 10 seconds")
        self._name = port_name
        self._baud_rate = baud_rate
        self._reply_timeout = reply_timeout
        self._write_timeout = write_timeout
        self._handler: _WaitingPortHandler | None = None
        self._packets = Protocol1PacketHandler()

    @property
    def name(self) -> str:
        """Device, for messages."""
        return self._name

    @property
    def baud_rate(self) -> int:
        """Bits per second."""
        return self._baud_rate

    @property
    def is_open(self) -> bool:
        """Whether the device is open."""
        return self._handler is not None

    def open(self) -> None:
        """Open the device and lock it, so that no second program disturbs the bus.

        Raises:
            PortMissingError: There is no such device.
            PortBusyError: Another program holds it.
            PortPermissionError: The user may not open it.
            PortError: It is no serial port, or fails for another reason.
        """
        if self._handler is not None:
            return
        handler = _WaitingPortHandler(
            self._name, self._baud_rate, self._reply_timeout, self._write_timeout
        )
        try:
            handler.openPort()
        except (OSError, termios.error) as cause:
            if handler.is_open:
                handler.closePort()
            raise port_error(self._name, cause, serial_ports()) from cause
        self._handler = handler

    def close(self) -> None:
        """Close the device; does nothing when it is closed or lost."""
        handler, self._handler = self._handler, None
        if handler is not None:
            try:
                handler.closePort()
            except (OSError, termios.error):
                return  # it has gone: there is nothing left to close

    def ping(self, servo_id: int) -> ErrorBits:
        """Ask a servo whether it is there; one packet, no read.

        Raises:
            CommunicationError: No usable answer.
            PortLostError: The device has gone.
        """
        packet = _instruction(servo_id, Instruction.PING)
        return ErrorBits(self._transact(packet, 0, "ping")[4])

    def read(self, servo_id: int, address: int, length: int) -> Reply:
        """Read `length` bytes from `address` on.

        Raises:
            CommunicationError: No usable answer.
            PortLostError: The device has gone.
        """
        packet = _instruction(servo_id, Instruction.READ, bytes((address, length)))
        received = self._transact(packet, length, f"read of {length} byte(s) at {address}")
        return Reply(bytes(received[5 : 5 + length]), ErrorBits(received[4]))

    def write(
        self, servo_id: int, address: int, data: bytes, *, acknowledged: bool = True
    ) -> ErrorBits:
        """Write bytes from `address` on.

        Args:
            servo_id: The servo.
            address: First register byte.
            data: What to write.
            acknowledged: Wait for the servo's status. Servos with a Status Return Level below 2
                send none.

        Raises:
            CommunicationError: No usable answer.
            PortLostError: The device has gone.
        """
        if acknowledged:
            packet = _instruction(servo_id, Instruction.WRITE, bytes((address, *data)))
            what = f"write of {len(data)} byte(s) at {address}"
            return ErrorBits(self._transact(packet, 0, what)[4])
        self._send(lambda handler: self._packets.writeTxOnly(
            handler, servo_id, address, len(data), list(data)
        ))  # fmt: skip
        return NO_ERROR

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        """Write the same registers of several servos in one packet, by id; nobody answers.

        Raises:
            CommunicationError: The packet cannot be sent.
            PortLostError: The device has gone.
        """
        if not data:
            return
        lengths = {len(share) for share in data.values()}
        if len(lengths) != 1:
            raise CommunicationError("a sync write needs the same number of bytes for every servo")
        parameters = [byte for servo_id, share in data.items() for byte in (servo_id, *share)]
        self._send(lambda handler: self._packets.syncWriteTxOnly(
            handler, address, lengths.pop(), parameters, len(parameters)
        ))  # fmt: skip

    def _transact(self, packet: list[int], data_length: int, what: str) -> list[int]:
        """Send an instruction and return the status packet with exactly `data_length` data."""
        handler = self._open_handler()
        try:
            received, result, _ = self._packets.txRxPacket(handler, packet)
        except (OSError, termios.error) as cause:
            raise self._lost(cause) from cause
        except IndexError as cause:
            raise CorruptReplyError(f"servo {packet[2]}: garbled reply to a {what}") from cause
        finally:
            handler.is_using = False
        if result != COMM_SUCCESS:
            raise self._failure(result, packet[2], what)
        error = ErrorBits(received[4])
        if error & ErrorBits.CHECKSUM:
            raise CorruptReplyError(f"servo {packet[2]} received a damaged {what}")
        if received[3] != data_length + 2 or len(received) != data_length + _OVERHEAD:
            raise CorruptReplyError(
                f"servo {packet[2]} answered a {what} with {max(0, received[3] - 2)} byte(s) of "
                f"data; error bits: {describe_errors(error)}"
            )
        return list(received)

    def _send(self, transmit: _Transmit) -> None:
        handler = self._open_handler()
        try:
            result = transmit(handler)
        except (OSError, termios.error) as cause:
            raise self._lost(cause) from cause
        finally:
            handler.is_using = False
        if result != COMM_SUCCESS:
            raise CommunicationError(f"{self._name}: {self._packets.getTxRxResult(result)}")

    def _open_handler(self) -> _WaitingPortHandler:
        if self._handler is None:
            raise NotConnectedError(f"{self._name} is not open; call open() first")
        return self._handler

    def _lost(self, cause: Exception) -> PortLostError:
        self.close()
        return PortLostError(self._name, cause)

    def _failure(self, result: int, servo_id: int, what: str) -> DynamixelError:
        if result == COMM_RX_TIMEOUT:
            return ReplyTimeoutError(
                f"servo {servo_id} did not answer a {what} within "
                f"{self._reply_timeout * 1e3:.0f} ms on {self._name} at {self._baud_rate} baud"
            )
        if result == COMM_RX_CORRUPT:
            return CorruptReplyError(f"servo {servo_id}: damaged reply to a {what}")
        return CommunicationError(
            f"servo {servo_id}: {what} failed: {self._packets.getTxRxResult(result)}"
        )


def _instruction(servo_id: int, instruction: Instruction, parameters: bytes = b"") -> list[int]:
    """Return the packet as the SDK wants it: header and checksum are left to it."""
    return [0xFF, 0xFF, servo_id, len(parameters) + 2, instruction, *parameters, 0]


def _check_baud_rate(baud_rate: int) -> None:
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
