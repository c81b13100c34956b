"""A line at the bottom of the terminal that is written anew, with log messages above it."""

from __future__ import annotations

import os
import sys
import threading
import time
from typing import TextIO

_CLEAR = "\r\x1b[K"
_FORMAT = "RCUTILS_CONSOLE_OUTPUT_FORMAT"


class StatusLine:
    """Writes over its last text on a terminal; elsewhere a new line once a second."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._terminal = self._stream.isatty()
        self._last = -1.0
        self._ended = False
        self._lock = threading.Lock()

    def prepare_logging(self) -> None:
        """Lets ROS's log messages clear the line first; to be called before rclpy.init."""
        if self._terminal:
            os.environ.setdefault(
                _FORMAT, f"{_CLEAR}[{{severity}}] [{{time}}] [{{name}}]: {{message}}"
            )

    def show(self, text: str) -> None:
        """Shows the newest text, unless the end was told."""
        with self._lock:
            if self._ended:
                return
            if self._terminal:
                width = os.get_terminal_size(self._stream.fileno()).columns
                # a terminal that does not know its width says 0
                self._write(_CLEAR + (text[: width - 1] if width else text))
            elif time.monotonic() - self._last >= 1.0:
                self._last = time.monotonic()
                self._write(text + "\n")

    def end(self, text: str) -> None:
        """Leaves `text` as the last line."""
        with self._lock:
            self._ended = True
            self._write((_CLEAR if self._terminal else "") + text + "\n")

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()
