"""The person in front of the tool: what they are told, and what they answer."""

from __future__ import annotations

import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from head_tracking.servo_tool.exceptions import RefusedError

_LOOKS = 10.0  # Hz
_PLAIN_WIDTH = 120  # where there is no terminal that has one


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
