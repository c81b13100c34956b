"""The terminal, the port and its servos, for the commands of `servo`."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import track

from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.servo import Servo
from head_tracking.exceptions import HeadTrackingError, RefusedError

T = TypeVar("T")

_RATE = 10.0  # Hz
_PLAIN_WIDTH = 120  # columns of the output without a terminal
_ATTEMPTS = 3
_FEETECH_BYTE_ORDER = 2  # address; the id is three bytes after it
_TIMEOUT = (
    0.03  # s; long, because the id of a servo that is not found could be given to another one
)


class ToolError(HeadTrackingError):
    """The command cannot be carried out."""


class Terminal:
    """Standard input; standard output for results; standard error for messages.

    Args:
        assume_yes: answer every question with yes.
    """

    def __init__(self, *, assume_yes: bool = False) -> None:
        width = None if sys.stdout.isatty() else _PLAIN_WIDTH
        self._output = Console(file=sys.stdout, highlight=False, width=width)
        self._messages = Console(file=sys.stderr, highlight=False, soft_wrap=True)
        self._input = sys.stdin
        self._assume_yes = assume_yes

    def show(self, content: RenderableType) -> None:
        """Print a result."""
        self._output.print(content, markup=False)

    def print(self, text: str) -> None:
        """Print a message."""
        self._messages.print(text, markup=False)

    def confirm(self, question: str) -> None:
        """Ask a question; raise RefusedError unless the answer is yes."""
        if self._assume_yes:
            return
        if not self._input.isatty():
            raise RefusedError(
                f"{question} Confirmation is needed, but stdin is not a terminal; add --yes"
            )
        self._messages.print(f"{question} [y/N] ", end="", markup=False)
        if self._input.readline().strip().lower() not in ("y", "yes"):
            raise RefusedError("nothing was changed")

    def ask(self, question: str, default: str) -> str:
        """Return the answer to a question; the default after Enter or without a terminal."""
        if self._assume_yes or not self._input.isatty():
            self.print(f"{question}: {default}")
            return default
        self._messages.print(f"{question} [{default}]: ", end="", markup=False)
        return self._input.readline().strip() or default

    def wait_for_enter(self, prompt: str, read: Callable[[], str]) -> None:
        """Wait until Enter is pressed, and show the result of `read` meanwhile."""
        self.print(prompt)
        with Live(console=self._messages, auto_refresh=False, transient=True) as live:
            while not select.select([self._input], [], [], 1.0 / _RATE)[0]:
                live.update(read(), refresh=True)
        if not self._input.readline():
            raise RefusedError("the input has ended; nothing was written")

    def track(self, items: Sequence[T], description: str) -> Iterable[T]:
        """Iterate with a progress bar."""
        return track(items, description, console=self._messages, transient=True)

    @contextmanager
    def screen(self) -> Iterator[Callable[[RenderableType], None]]:
        """Return a function that replaces the shown content; without a terminal it prints."""
        if not self._output.is_terminal:
            yield self.show
            return
        with Live(console=self._output, auto_refresh=False) as live:
            yield lambda content: live.update(content, refresh=True)


def patient_port(port_name: str, baud_rate: int) -> DynamixelPort:
    """Return a closed port with a long reply timeout."""
    return DynamixelPort(port_name, baud_rate, reply_timeout=_TIMEOUT)


@dataclass(frozen=True, slots=True)
class Session:
    """The terminal and the port of one command.

    Attributes:
        terminal: for input and output.
        port_name: serial device.
        baud_rate: default baud rate [bit/s].
        make_port: makes a closed port from device and baud rate.
        pause: waits for a time [s].
        clock: returns monotonic time [s].
    """

    terminal: Terminal
    port_name: str
    baud_rate: int
    make_port: Callable[[str, int], DynamixelPort] = patient_port
    pause: Callable[[float], object] = time.sleep
    clock: Callable[[], float] = time.monotonic

    @contextmanager
    def port(self, baud_rate: int | None = None) -> Iterator[DynamixelPort]:
        """Open the port; close it at the end of the block.

        Raises:
            PortError: the port cannot be opened, or does not support the baud rate.
            ConfigurationError: no port supports the baud rate.
        """
        port = self.make_port(self.port_name, self.baud_rate if baud_rate is None else baud_rate)
        port.open()
        try:
            if port.adapter.advice:
                self.terminal.print(f"note: {port.adapter.advice}")
            yield port
        finally:
            port.close()


def protocol_of(port: DynamixelPort, servo_id: int, attempts: int = _ATTEMPTS) -> int | None:
    """Return the protocol in which a servo answers pings, also with a corrupt answer; or None."""
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


def find_servo(port: DynamixelPort, servo_id: int, model: ServoModel | None = None) -> Servo:
    """Return the servo with an id.

    Args:
        port: the open port.
        servo_id: the id.
        model: model of a servo that answers no reads.

    Raises:
        ToolError: the servo does not answer, or its model is unknown.
    """
    protocol = protocol_of(port, servo_id)
    if protocol is None:
        raise ToolError(
            f"no servo with id {servo_id} answers on {port.name} at {port.baud_rate} baud; check "
            "its power and cable, or find it with `servo scan`"
        )
    try:
        servo = Servo(port, servo_id, servo_model_by_number(model_number(port, servo_id, protocol)))
    except ConfigurationError as error:
        raise ToolError(f"servo {servo_id}: {error}") from error
    except CommunicationError as error:
        if model is None:
            raise ToolError(
                f"servo {servo_id} answers pings but no reads: its Status Return Level is "
                "probably 0. Set it to 2 and give the model: "
                f"servo --model MODEL set {servo_id} 'Status Return Level' 2"
            ) from error
        servo = Servo(port, servo_id, model)
        servo.acknowledges_writes = False
        return servo
    servo.acknowledges_writes = servo.model.acknowledges_writes(servo.get("Status Return Level"))
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
        byte_order, *_, own_id = port.read(servo_id, _FEETECH_BYTE_ORDER, 4).data
        if own_id == servo_id and byte_order in (0, 1):
            any_model = servo_model("SCS0009" if byte_order else "STS3215")
    return Servo(port, servo_id, any_model).get("Model Number")
