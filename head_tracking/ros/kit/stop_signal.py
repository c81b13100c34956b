"""Whoever wants a program to end, as something to ask for, before anything slow is imported."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Ctrl-C, `kill`, a closed terminal or lost connection, and Ctrl-backslash."""


class EndRequestedError(Exception):
    """Somebody asked to stop before everything had started."""


class StopSignal:
    """Waits for a signal to end instead of letting rclpy shut down under the nodes' feet."""

    def __init__(self) -> None:
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
        self.set()

    @contextmanager
    def while_importing(self) -> Iterator[None]:
        """Until the end of the block there is nothing to end: who asks to stop ends the process."""
        self._importing = True
        try:
            yield
        finally:
            self._importing = False

    def __call__(self) -> bool:
        """Whether it is time to stop."""
        return self._stopped.is_set()

    def set(self) -> None:
        """Asks to stop."""
        self._stopped.set()
        if self._importing:
            os._exit(0)

    def check(self) -> None:
        """To be called between the steps of a start.

        Raises:
            EndRequestedError: it is time to stop.
        """
        if self._stopped.is_set():
            raise EndRequestedError

    def wait(self, seconds: float) -> bool:
        """Waits for a signal; whether there was one."""
        return self._stopped.wait(seconds)
