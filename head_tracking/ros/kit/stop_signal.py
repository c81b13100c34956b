"""Signals that end a program. Importing this module is fast: it needs no ROS."""

from __future__ import annotations

import queue
import signal
from contextlib import suppress
from typing import Any, Final

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Ctrl-C, `kill`, a closed terminal or lost connection, and Ctrl-backslash."""


class EndRequestedError(Exception):
    """The program was asked to end before everything had started."""


class StopSignal:
    """Records signals that end the program; the program ends its nodes before rclpy.

    A context manager, which restores the signal handlers; if the program was asked to end, further
    signals are ignored from then on: they would interrupt its end.
    """

    def __init__(self) -> None:
        self._asked = False
        # a handler may interrupt this queue in its own `get` or `put`; an Event would lock then
        self._woken: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> StopSignal:
        for number in ENDING:
            if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                continue  # started by nohup, to outlive its terminal
            self._previous[number] = signal.signal(number, lambda *_: self.set())
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, signal.SIG_IGN if self._asked else handler)

    def __call__(self) -> bool:
        """Return whether the program has been asked to end."""
        return self._asked

    def set(self) -> None:
        """Ask the program to end."""
        self._asked = True
        self._woken.put(None)

    def check(self) -> None:
        """Raise an EndRequestedError if the program has been asked to end."""
        if self._asked:
            raise EndRequestedError

    def wait(self, seconds: float) -> bool:
        """Wait for at most this time; return whether the program has been asked to end."""
        with suppress(queue.Empty):
            self._woken.put(self._woken.get(timeout=max(seconds, 0.0)))  # others may wait as well
        return self._asked
