"""The terminal, the port and its servos, for the commands of `servo`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass

from head_tracking.cli.terminal import Terminal
from head_tracking.dynamixel.exceptions import (
    ConfigurationError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import MAX_ID
from head_tracking.dynamixel.servo import MOST_TRIES, Servo, answering
from head_tracking.exceptions import HeadTrackingError

USUAL_BAUD_RATES = (1_000_000, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000)
"""Baud rates of the factories and other common ones; the most common first."""

FIRST_IDS = range(30)
"""Ids that are searched for a servo: a ping of all takes several seconds."""

_ATTEMPTS = 3
_BYTES_2_TO_5 = ("Firmware Version", "ID", "Baud Rate", "Return Delay Time")  # names of an AX-12
_TIMEOUT = 0.03  # s; long: the id of a servo that is not found could be given to another one


class ToolError(HeadTrackingError):
    """The command cannot be carried out."""


def patient_port(port_name: str, baud_rate: int) -> DynamixelPort:
    """Return a closed port with a long reply timeout."""
    return DynamixelPort(port_name, baud_rate, reply_timeout=_TIMEOUT)


@dataclass(frozen=True, slots=True)
class Session:
    """The terminal and the port of one command.

    Attributes:
        make_port: makes a closed port from device and baud rate.
        model: of a servo that answers no reads.
    """

    terminal: Terminal
    port_name: str
    baud_rate: int
    make_port: Callable[[str, int], DynamixelPort] = patient_port
    pause: Callable[[float], object] = time.sleep
    model: ServoModel | None = None

    @contextmanager
    def port(self, baud_rate: int | None = None) -> Iterator[DynamixelPort]:
        """Open the port; close it at the end of the block.

        Raises:
            PortError: the port cannot be opened.
            ConfigurationError: it does not support the baud rate.
        """
        port = self.make_port(self.port_name, self.baud_rate if baud_rate is None else baud_rate)
        port.open()
        with closing(port):
            if port.adapter.advice:
                self.terminal.print(f"note: {port.adapter.advice}")
            yield port


def answers(port: DynamixelPort, servo_id: int, protocol: int, attempts: int = _ATTEMPTS) -> bool:
    """Return whether a servo answers pings, also with a corrupt answer."""
    model = servo_model("AX-12" if protocol == 1 else "XM430-W350")
    return servo_id <= MAX_ID[protocol] and bool(
        answering([Servo(port, servo_id, model)], attempts)
    )


def protocol_of(port: DynamixelPort, servo_id: int, attempts: int = _ATTEMPTS) -> int | None:
    """Return the protocol in which a servo answers pings; None if it does not."""
    return next((p for p in MAX_ID if answers(port, servo_id, p, attempts)), None)


def first_ids(port: DynamixelPort) -> Iterator[int]:
    """Yield the ids in `FIRST_IDS` that answer pings."""
    for servo_id in FIRST_IDS:
        if protocol_of(port, servo_id, attempts=1) and protocol_of(port, servo_id):  # no noise
            yield servo_id


def none_answers(port: DynamixelPort) -> ToolError:
    """Return the error that no servo was found."""
    return ToolError(
        f"no servo with an id up to {FIRST_IDS[-1]} answers at {port.baud_rate} baud; give the "
        f"ids, or find servos with `{port.servo_command('scan')}`"
    )


def find_servo(port: DynamixelPort, servo_id: int, model: ServoModel | None = None) -> Servo:
    """Return the servo with an id; `model` is needed for one that answers no reads.

    Raises:
        ToolError: the servo does not answer, or its model is unknown.
    """
    protocol = protocol_of(port, servo_id, MOST_TRIES)
    if protocol is None:
        raise ToolError(
            f"no servo with id {servo_id} answers on {port.name} at {port.baud_rate} baud; check "
            f"its power and cable, or find it with `{port.servo_command('scan')}`"
        )
    try:
        servo = Servo(port, servo_id, servo_model_by_number(model_number(port, servo_id, protocol)))
    except ConfigurationError as error:
        raise ToolError(f"servo {servo_id}: {error}") from error
    except ReplyTimeoutError as error:
        if model is None:
            raise ToolError(
                f"servo {servo_id} answers pings but no reads: its Status Return Level is "
                "probably 0. Set it to 2 and give the model: "
                + port.servo_command(f"--model MODEL set {servo_id} 'Status Return Level' 2")
            ) from error
        servo = Servo(port, servo_id, model)
        servo.acknowledges_writes = False
        return servo
    level = servo.get("Status Return Level", MOST_TRIES)
    servo.acknowledges_writes = servo.model.acknowledges_writes(level)
    return servo


def model_number(port: DynamixelPort, servo_id: int, protocol: int) -> int:
    """Read the Model Number.

    Its address differs between Dynamixel and Feetech. A Feetech servo has two bytes of firmware
    version, then a byte order of 0 or 1; its id is at address 5.

    Raises:
        CommunicationError: the servo answers no reads, or its answers are corrupt.
    """
    any_model = servo_model("AX-12" if protocol == 1 else "XM430-W350")
    if protocol == 1:
        block = any_model.control_table.block(*_BYTES_2_TO_5)
        byte_order, *_, own_id = Servo(port, servo_id, any_model).read(block, MOST_TRIES)
        if own_id == servo_id and byte_order in (0, 1):
            any_model = servo_model("SCS0009" if byte_order else "STS3215")
    return Servo(port, servo_id, any_model).get("Model Number", MOST_TRIES)
