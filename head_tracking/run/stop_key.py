"""STOP by one key in the terminal of a run."""

from __future__ import annotations

import os
import re
import signal
import sys
import termios
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final, TextIO

from head_tracking.exceptions import HeadTrackingError

HINT: Final = "space: STOP"
"""What the status line says where the keys work."""

STOP, RESUME = "stop", "resume"

_STOP_KEYS: Final = frozenset(b" sS")
_RESUME_KEYS: Final = frozenset(b"rR")
_SEQUENCE: Final = re.compile(rb"\x1b(\[[0-?]*[ -/]*[@-~]|O.)")  # of an arrow or a function key


class StopKey:
    """Reads single keys while the program has its terminal for itself; for a loop by a selector.

    Space or `s` stops, `r` resumes, any other key does nothing. In the background, and while the
    program is suspended, the terminal is left as it was found.

    Args:
        stream: where keys come from; nothing is read if it is no terminal.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._terminal = _descriptor(stream or sys.stdin)
        self._found: list[Any] | None = None  # the terminal's settings; None: left as it was
        if self._terminal is not None:
            signal.signal(signal.SIGTTIN, signal.SIG_IGN)  # a read that is too late fails

    @property
    def has_terminal(self) -> bool:
        """Whether keys can come at all."""
        return self._terminal is not None

    @property
    def works(self) -> bool:
        """Whether keys are read now."""
        return self._found is not None

    def fileno(self) -> int:
        """Return the descriptor of the terminal, for a selector."""
        assert self._terminal is not None
        return self._terminal

    def acquire(self) -> None:
        """Have keys sent one by one and unseen, if the program is in the foreground."""
        if self._terminal is None:
            return
        if not self._in_foreground():
            self._found = None  # the shell has set it as it wants it
            return
        with suppress(termios.error, OSError):  # it has gone
            found = self._found or termios.tcgetattr(self._terminal)
            if not self.works:
                single = termios.tcgetattr(self._terminal)
                single[3] &= ~(termios.ICANON | termios.ECHO)  # Ctrl-C and Ctrl-Z stay signals
                single[6][termios.VMIN], single[6][termios.VTIME] = 0, 0
                # a key that was pressed while the program started counts
                termios.tcsetattr(self._terminal, termios.TCSANOW, single)
            self._found = found

    def release(self) -> None:
        """Set the terminal as it was found, unless another program has it now."""
        found, self._found = self._found, None
        if found is not None and self._terminal is not None and self._in_foreground():
            with suppress(termios.error, OSError):
                termios.tcsetattr(self._terminal, termios.TCSANOW, found)

    def suspend(self) -> None:
        """Suspend the program, as Ctrl-Z does; return after SIGCONT."""
        self.release()
        os.kill(os.getpid(), signal.SIGSTOP)

    def read(self) -> str:
        """Return STOP or RESUME if such a key was pressed, else an empty text; a stop wins."""
        keys = b""
        if self._in_foreground():  # else it would wait for a whole line
            with suppress(OSError):  # it has gone
                keys = os.read(self.fileno(), 64)
        return meaning(keys)

    def _in_foreground(self) -> bool:
        assert self._terminal is not None
        with suppress(OSError):  # it has gone, or is no longer ours
            return os.tcgetpgrp(self._terminal) == os.getpgrp()
        return False


def meaning(keys: bytes) -> str:
    """Return what keys ask for: STOP, RESUME or nothing."""
    pressed = frozenset(_SEQUENCE.sub(b"", keys))
    return STOP if pressed & _STOP_KEYS else RESUME if pressed & _RESUME_KEYS else ""


def carry_out(
    key: str, stop: Callable[[], Sequence[str]], resume: Callable[[], Sequence[str]]
) -> str:
    """Stop or resume, and return what to show.

    Args:
        key: STOP or RESUME.
        stop: relaxes the servos; returns one line for each, confirmed or not.
        resume: lets them be moved again; returns lines to show.
    """
    failed = "STOP: NOT confirmed" if key == STOP else "not resumed"
    try:
        if key == STOP:
            return f"STOP: {', '.join(stop()) or 'no servo is there'}; r resumes"
        return ": ".join(["resumed", *filter(None, [", ".join(resume())])])
    except HeadTrackingError as error:
        return f"{failed}: {error}"
    except Exception:
        return f"{traceback.format_exc()}{failed}"


def _descriptor(stream: TextIO | None) -> int | None:
    with suppress(OSError, ValueError):  # closed
        return stream.fileno() if stream is not None and stream.isatty() else None
    return None
