"""The port, the servos on it and the person: what every command needs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from head_tracking.dynamixel.dynamixel_port import DynamixelPort
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model_by_number
from head_tracking.dynamixel.servo_link import ServoLink
from head_tracking.servo_tool.exceptions import ToolError
from head_tracking.servo_tool.terminal import Terminal

_ATTEMPTS = 3
_TIMEOUT = 0.03  # s: a busy machine must not hide a servo whose id is about to be given away
_MODEL_NUMBER = (0, 2)  # address and bytes, the same for all models


def patient_port(port_name: str, baud_rate: int) -> DynamixelPort:
    """Return a closed port that rather waits than misses an answer."""
    return DynamixelPort(port_name, baud_rate, reply_timeout=_TIMEOUT)


@dataclass(frozen=True, slots=True)
class Workshop:
    """A bench with a port.

    Attributes:
        terminal: The person.
        port_name: Device.
        baud_rate: Bits per second, unless a command uses others.
        make_port: Makes a closed port from device and baud rate.
        pause: Waits so many seconds.
        clock: Monotonic time, s.
    """

    terminal: Terminal
    port_name: str
    baud_rate: int
    make_port: Callable[[str, int], DynamixelPort] = patient_port
    pause: Callable[[float], object] = time.sleep
    clock: Callable[[], float] = time.monotonic

    @contextmanager
    def port(self, baud_rate: int | None = None) -> Iterator[DynamixelPort]:
        """Open the port, and close it at the end.

        Raises:
            PortError: It cannot be opened, or cannot do the baud rate.
            ConfigurationError: Nobody can do the baud rate.
        """
        port = self.make_port(self.port_name, self.baud_rate if baud_rate is None else baud_rate)
        port.open()
        try:
            if port.adapter.advice:
                self.terminal.say(f"note: {port.adapter.advice}")
            yield port
        finally:
            port.close()


def protocol_of(port: DynamixelPort, servo_id: int, attempts: int = _ATTEMPTS) -> int | None:
    """Return the protocol in which a servo answers pings; None if none does.

    A damaged answer counts: somebody is there.
    """
    for attempt in range(attempts):
        for protocol in (1, 2):
            if protocol == 2 and servo_id > 252:
                continue
            try:
                port.ping(servo_id, protocol)
            except ReplyTimeoutError:
                continue
            except CorruptReplyError:
                if attempt < attempts - 1:
                    continue
            return protocol
    return None


def find_servo(port: DynamixelPort, servo_id: int, model: ServoModel | None = None) -> ServoLink:
    """Return the servo with an id.

    Args:
        port: The open port.
        servo_id: Its id.
        model: Its model, for a servo that answers no reads.

    Raises:
        ToolError: It does not answer, or is of a model that nobody knows.
    """
    protocol = protocol_of(port, servo_id)
    if protocol is None:
        raise ToolError(
            f"no servo with id {servo_id} answers on {port.name} at {port.baud_rate} baud; check "
            "its power and cable, or look for it with `servo scan`"
        )
    number = read_model_number(port, servo_id, protocol)
    if number is None:
        if model is None:
            raise ToolError(
                f"servo {servo_id} answers pings but no reads: its Status Return Level is "
                "probably 0. Tell its model, and set it to 2: "
                f"servo --model MODEL set {servo_id} 'Status Return Level' 2"
            )
        link = ServoLink(port, servo_id, model)
        link.acknowledges_writes = False
        return link
    try:
        link = ServoLink(port, servo_id, servo_model_by_number(number))
    except ConfigurationError as error:
        raise ToolError(f"servo {servo_id}: {error}") from error
    link.acknowledges_writes = link.get("Status Return Level") >= 2
    return link


def read_model_number(port: DynamixelPort, servo_id: int, protocol: int) -> int | None:
    """Return the model number of a servo; None if it answers no reads."""
    for _ in range(_ATTEMPTS):
        try:
            reply = port.read(servo_id, *_MODEL_NUMBER, protocol)
        except CommunicationError:
            continue
        return int.from_bytes(reply.data, "little")
    return None
