"""A bench: the person in front of the tool, the port, and the servos on it."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, TextIO

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.servo import Servo

_LOOKS = 10.0  # Hz
_PLAIN_WIDTH = 120  # where there is no terminal that has one
_ATTEMPTS = 3
_TIMEOUT = 0.03  # s: a busy machine must not hide a servo whose id is about to be given away
MODEL_NUMBER = (0, 2)  # address and bytes, the same for all models


class ToolError(Exception):
    """Something that was asked for cannot be done."""


class RefusedError(ToolError):
    """Something that was asked for could do harm, or was not confirmed."""


class Screen(Protocol):
    """Something that is shown and changes."""

    def update(self, content: RenderableType) -> None:
        """Show something else."""


class Terminal:
    """Speaks to a person, or to a script.

    Args:
        output: Where results go.
        messages: Where all else goes.
        input: Where answers come from.
        assume_yes: Answer every question with yes.
    """

    def __init__(
        self,
        output: TextIO = sys.stdout,
        messages: TextIO = sys.stderr,
        input: TextIO = sys.stdin,
        *,
        assume_yes: bool = False,
    ) -> None:
        width = None if output.isatty() else _PLAIN_WIDTH
        self._output = Console(file=output, highlight=False, width=width)
        self._messages = Console(file=messages, highlight=False, soft_wrap=True)
        self._input = input
        self._assume_yes = assume_yes

    @property
    def is_live(self) -> bool:
        """Whether what is shown can be changed."""
        return self._output.is_terminal

    def show(self, content: RenderableType) -> None:
        """Show a result."""
        self._output.print(content, markup=False)

    def say(self, text: str) -> None:
        """Tell something by the way."""
        self._messages.print(text, markup=False)

    def confirm(self, question: str) -> None:
        """Ask whether to go on.

        Raises:
            RefusedError: The answer is no, or there is nobody to ask.
        """
        if self._assume_yes:
            return
        if not self._input.isatty():
            raise RefusedError(f"{question} Nobody is there to say yes; add --yes")
        self._messages.print(f"{question} [y/N] ", end="", markup=False)
        if self._input.readline().strip().lower() not in ("y", "yes"):
            raise RefusedError("nothing was changed")

    def wait_for_enter(self, prompt: str, look: Callable[[], str]) -> None:
        """Wait until somebody presses Enter, and show what `look` returns in the meantime."""
        self.say(prompt)
        with Live(console=self._messages, auto_refresh=False, transient=True) as live:
            while not self._has_input():
                live.update(look(), refresh=True)
        if not self._input.readline():
            raise RefusedError("nobody is there to press Enter; nothing was written")

    @contextmanager
    def progress(self, total: int) -> Iterator[Callable[[str, int], None]]:
        """Show a progress bar; what it gives takes what is being done and the steps done."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        with Progress(*columns, console=self._messages, transient=True) as progress:
            task = progress.add_task("", total=total)

            def advance(what: str, steps: int) -> None:
                progress.update(task, description=what, advance=steps)

            yield advance

    @contextmanager
    def screen(self) -> Iterator[Screen]:
        """Show something that changes; without a terminal each state is shown after the other."""
        if not self.is_live:
            yield _Roll(self)
            return
        with Live(console=self._output, auto_refresh=False) as live:
            yield _LiveScreen(live)

    def _has_input(self) -> bool:
        return bool(select.select([self._input], [], [], 1.0 / _LOOKS)[0])


class _Roll:
    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal

    def update(self, content: RenderableType) -> None:
        self._terminal.show(content)


class _LiveScreen:
    def __init__(self, live: Live) -> None:
        self._live = live

    def update(self, content: RenderableType) -> None:
        self._live.update(content, refresh=True)


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


def find_servo(port: DynamixelPort, servo_id: int, model: ServoModel | None = None) -> Servo:
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
        link = Servo(port, servo_id, model)
        link.acknowledges_writes = False
        return link
    try:
        link = Servo(port, servo_id, servo_model_by_number(number))
    except ConfigurationError as error:
        raise ToolError(f"servo {servo_id}: {error}") from error
    link.acknowledges_writes = link.get("Status Return Level") >= 2
    return link


def read_model_number(port: DynamixelPort, servo_id: int, protocol: int) -> int | None:
    """Return the model number of a servo; None if it answers no reads."""
    for _ in range(_ATTEMPTS):
        try:
            reply = port.read(servo_id, *MODEL_NUMBER, protocol)
        except CommunicationError:
            continue
        return int.from_bytes(reply.data, "little")
    return None
