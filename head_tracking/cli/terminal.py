"""Questions, tables, progress and live values of the tools, on standard input and output."""

from __future__ import annotations

import select
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import track

from head_tracking.exceptions import RefusedError

T = TypeVar("T")

_RATE = 10.0  # Hz
_PLAIN_WIDTH = 2000  # columns without a terminal: no line is broken


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

    def print(self, text: str, end: str = "\n") -> None:
        """Print a message."""
        self._messages.print(text, end=end, markup=False)

    def confirm(self, question: str) -> None:
        """Ask a question; raise RefusedError unless the answer is yes."""
        if not (self._assume_yes or self._input.isatty()):
            raise RefusedError(
                f"{question} Confirmation is needed, but stdin is not a terminal; add --yes"
            )
        if not self._assume_yes:
            self.print(f"{question} [y/N] ", end="")
            if self._answer().lower() not in ("y", "yes"):
                raise RefusedError("nothing was changed")

    def ask(self, question: str, default: str) -> str:
        """Return the answer to a question; the default after Enter or without a terminal."""
        if self._assume_yes or not self._input.isatty():
            self.print(f"{question}: {default}")
            return default
        self.print(f"{question} [{default}]: ", end="")
        return self._answer() or default

    def wait_for_enter(self, prompt: str, read: Callable[[], str]) -> None:
        """Wait until Enter is pressed, and show the result of `read` meanwhile."""
        self.print(prompt)
        with Live(console=self._messages, auto_refresh=False, transient=True) as live:
            while not select.select([self._input], [], [], 1.0 / _RATE)[0]:
                live.update(read(), refresh=True)
        self._answer()

    def _answer(self) -> str:
        """Return the line that is typed; raise RefusedError after Ctrl-D."""
        line = self._input.readline()
        if not line:
            raise RefusedError("the input has ended; nothing was changed")
        return line.strip()

    def track(self, items: Sequence[T], description: str) -> Iterable[T]:
        """Iterate with a progress bar."""
        return track(items, description, console=self._messages, transient=True)

    @contextmanager
    def screen(self) -> Iterator[Callable[[RenderableType], None]]:
        """Return a function that replaces the shown content, or prints where that is impossible."""
        if not self._output.is_terminal or self._output.is_dumb_terminal:
            yield self.show
            return
        with Live(console=self._output, auto_refresh=False) as live:
            yield lambda content: live.update(content, refresh=True)
