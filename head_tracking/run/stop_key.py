"""Keys for STOP and resume in the terminal of a run."""

from __future__ import annotations

import os
import re
import signal
import sys
import termios
from contextlib import suppress
from typing import Any, Final, TextIO

HINT: Final = "space: STOP"
"""Part of the status line while the keys work."""

STOP, RESUME = "stop", "resume"

_STOP_KEYS: Final = frozenset(b" sS")
_RESUME_KEYS: Final = frozenset(b"rR")
_SEQUENCE: Final = re.compile(rb"\x1b(\[[0-?]*[ -/]*[@-~]|O.)")  # arrow and function keys


class StopKey:
    """Reads single keys while the program is in the foreground of its terminal.

    Space or `s` stops, `r` resumes, other keys do nothing. While the program is in the background
    or suspended, the terminal has its original settings.

    Args:
        stream: the terminal; without one no keys are read.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._terminal = _descriptor(stream or sys.stdin)
        self._original: list[Any] | None = None  # settings of the terminal; None: not changed
        if self._terminal is not None:
            signal.signal(signal.SIGTTIN, signal.SIG_IGN)  # a read in the background fails

    @property
    def works(self) -> bool:
        """Whether keys are read now."""
        return self._original is not None

    def fileno(self) -> int:
        """Return the descriptor of the terminal, for a selector."""
        assert self._terminal is not None
        return self._terminal

    def acquire(self) -> None:
        """Switch the terminal to single keys without echo, if the program is in the foreground.

        Call it repeatedly: the shell restores its settings when the program is suspended.
        """
        if self._terminal is None:
            return
        if not self._in_foreground():
            self._original = None
            return
        with suppress(termios.error, OSError):  # closed
            settings = termios.tcgetattr(self._terminal)
            if not self.works or settings[3] & termios.ICANON:
                single = termios.tcgetattr(self._terminal)
                single[3] &= ~(termios.ICANON | termios.ECHO)  # Ctrl-C and Ctrl-Z stay signals
                single[6][termios.VMIN], single[6][termios.VTIME] = 0, 0
                # TCSANOW keeps a key that was pressed during the start
                termios.tcsetattr(self._terminal, termios.TCSANOW, single)
                self._original = settings

    def release(self) -> None:
        """Restore the settings of the terminal, unless another program is in the foreground."""
        original, self._original = self._original, None
        if original is not None and self._terminal is not None and self._in_foreground():
            with suppress(termios.error, OSError):
                termios.tcsetattr(self._terminal, termios.TCSANOW, original)

    def read(self) -> str:
        """Return STOP, RESUME or an empty text for the pressed keys; see `meaning`."""
        keys = b""
        if self._in_foreground():  # else the read would wait for a line
            with suppress(OSError):  # closed
                keys = os.read(self.fileno(), 64)
        return meaning(keys)

    def _in_foreground(self) -> bool:
        assert self._terminal is not None
        with suppress(OSError):  # closed, or the terminal of another session
            return os.tcgetpgrp(self._terminal) == os.getpgrp()
        return False


def meaning(keys: bytes) -> str:
    """Return STOP, RESUME or an empty text for pressed keys; STOP has priority."""
    pressed = frozenset(_SEQUENCE.sub(b"", keys))
    return STOP if pressed & _STOP_KEYS else RESUME if pressed & _RESUME_KEYS else ""


def _descriptor(stream: TextIO | None) -> int | None:
    with suppress(OSError, ValueError):  # closed
        return stream.fileno() if stream is not None and stream.isatty() else None
    return None
