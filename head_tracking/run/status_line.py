"""A status line at the bottom of the terminal, below the log messages."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Sequence
from typing import Final, TextIO

CLEAR_LINE: Final = "\r\x1b[K"
_LOG_FORMAT = "RCUTILS_CONSOLE_OUTPUT_FORMAT"
_SEPARATOR = " | "


class StatusLine:
    """Overwrites its last text on a terminal; elsewhere prints a new line once a second.

    A terminal that cannot clear a line (TERM=dumb, such as a shell of Emacs) is none.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._is_terminal = can_clear_line(self._stream)
        self._last_time = -1.0
        self._text = ""
        self._has_ended = False
        self._lock = threading.Lock()

    def prepare_logging(self) -> None:
        """Let ROS's log messages clear the line first, without time stamps; call before rclpy.init.

        The log file still has the time stamps.
        """
        if self._is_terminal:
            os.environ.setdefault(_LOG_FORMAT, f"{CLEAR_LINE}[{{severity}}] {{name}}: {{message}}")

    def show(self, parts: Sequence[str]) -> None:
        """Show the latest status; nothing after `end`. Parts that do not fit are left out."""
        with self._lock:
            if self._has_ended:
                return
            if self._is_terminal:
                self._text = self._fit(parts)
                self._write(CLEAR_LINE + self._text)
            elif time.monotonic() - self._last_time >= 1.0:
                self._last_time = time.monotonic()
                self._write(_SEPARATOR.join(parts) + "\n")

    def print(self, text: str) -> None:
        """Print a line above the status."""
        with self._lock:
            if self._is_terminal:
                self._write(f"{CLEAR_LINE}{text}\n{'' if self._has_ended else self._text}")
            else:
                self._write(f"{text}\n")

    def end(self, text: str) -> None:
        """Replace the status by a last text; empty: remove it."""
        with self._lock:
            self._has_ended = True
            self._write((CLEAR_LINE if self._is_terminal else "") + (text and f"{text}\n"))

    def _fit(self, parts: Sequence[str]) -> str:
        """Return the parts that fit into one line of the terminal."""
        try:
            width = os.get_terminal_size(self._stream.fileno()).columns
        except OSError:
            width = 0
        limit = width - 1 if width else sys.maxsize  # 0: the terminal does not report its width
        fitting = [parts[0][:limit]] if parts else []
        for part in parts[1:]:
            if len(_SEPARATOR.join([*fitting, part])) <= limit:
                fitting.append(part)
        return _SEPARATOR.join(fitting)

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def can_clear_line(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that knows `CLEAR_LINE`."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"
