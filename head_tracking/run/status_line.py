"""A line at the bottom of the terminal that is written anew, with log messages above it."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Sequence
from typing import TextIO

from head_tracking.compatibility import StrEnum

_CLEAR = "\r\x1b[K"
_FORMAT = "RCUTILS_CONSOLE_OUTPUT_FORMAT"
_BETWEEN = " | "


class Mood(StrEnum):
    """How the first part of the line looks, where there are colours."""

    PLAIN = ""
    GOOD = "\x1b[32m"
    WATCH = "\x1b[33m"
    BAD = "\x1b[1;31m"


class StatusLine:
    """Writes over its last text on a terminal; elsewhere a new line once a second.

    Colours are used on a terminal, unless NO_COLOR is set or it is a dumb one.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._terminal = self._stream.isatty()
        self._coloured = (
            self._terminal
            and not os.environ.get("NO_COLOR")
            and os.environ.get("TERM", "dumb") != "dumb"
        )
        self._last = -1.0
        self._shown = ""
        self._ended = False
        self._lock = threading.Lock()

    def prepare_logging(self) -> None:
        """Lets ROS's log messages clear the line first; to be called before rclpy.init.

        On a terminal their stamps, which few can read, are left to the log file.
        """
        if self._terminal:
            os.environ.setdefault(_FORMAT, f"{_CLEAR}[{{severity}}] {{name}}: {{message}}")
            if not self._coloured:
                os.environ.setdefault("RCUTILS_COLORIZED_OUTPUT", "0")

    def show(self, parts: Sequence[str], mood: Mood = Mood.PLAIN) -> None:
        """Shows the newest text, unless the end was told.

        Args:
            parts: what is most important first; a part that does not fit is left out.
            mood: of the first part.
        """
        with self._lock:
            if self._ended:
                return
            if self._terminal:
                self._shown = self._fitting(parts, mood)
                self._write(_CLEAR + self._shown)
            elif time.monotonic() - self._last >= 1.0:
                self._last = time.monotonic()
                self._write(_BETWEEN.join(parts) + "\n")

    def say(self, text: str) -> None:
        """Writes a line of its own, above the status."""
        with self._lock:
            self._write(
                f"{_CLEAR}{text}\n{'' if self._ended else self._shown}"
                if self._terminal
                else f"{text}\n"
            )

    def end(self, text: str) -> None:
        """Leaves `text` as the last lines."""
        with self._lock:
            self._ended = True
            self._write((_CLEAR if self._terminal else "") + text + "\n")

    def _fitting(self, parts: Sequence[str], mood: Mood) -> str:
        """As many of the parts as the terminal is wide, in one line."""
        try:
            width = os.get_terminal_size(self._stream.fileno()).columns
        except OSError:
            width = 0
        room = width - 1 if width else sys.maxsize  # one that does not know its width says 0
        taken = [parts[0][:room]] if parts else []
        for part in parts[1:]:
            if len(_BETWEEN.join([*taken, part])) <= room:
                taken.append(part)
        if taken and mood and self._coloured:
            taken[0] = f"{mood}{taken[0]}\x1b[0m"
        return _BETWEEN.join(taken)

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()
