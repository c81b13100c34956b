"""Signals that end a program. Importing this module is fast: it needs no ROS."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Ctrl-C, `kill`, a closed terminal or lost connection, and Ctrl-backslash."""


class EndRequestedError(Exception):
    """The program was asked to end before everything had started."""


_POLL = 0.05  # s within which `wait` notices a signal


class StopSignal:
    """Records signals that end the program; the program ends its nodes before rclpy.

    A context manager, which restores the signal handlers.
    """

    def __init__(self) -> None:
        self._asked = False
        self._stopped = threading.Event()
        self._importing = False
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> StopSignal:
        for number in ENDING:
            if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                continue  # started by nohup, to outlive its terminal
            self._previous[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        # an Event would wait for ever if the signal interrupts its own `wait` or `set`
        self._asked = True
        if self._importing:
            os._exit(0)

    @contextmanager
    def while_importing(self) -> Iterator[None]:
        """End the process at once if it is asked to end in this block: nothing runs yet."""
        self._importing = True
        try:
            yield
        finally:
            self._importing = False

    def __call__(self) -> bool:
        """Return whether the program has been asked to end."""
        return self._asked

    def set(self) -> None:
        """Ask the program to end; not from the handler of a signal."""
        self._asked = True
        self._stopped.set()
        if self._importing:
            os._exit(0)

    def check(self) -> None:
        """Raise an EndRequestedError if the program has been asked to end."""
        if self._asked:
            raise EndRequestedError

    def wait(self, seconds: float) -> bool:
        """Wait for at most this time; return whether the program has been asked to end."""
        end = time.monotonic() + seconds
        while not self._asked and (left := end - time.monotonic()) > 0.0:
            self._stopped.wait(min(left, _POLL))
        return self._asked
