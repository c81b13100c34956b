"""STOP by one key in the terminal of a run."""

from __future__ import annotations

import atexit
import os
import re
import select
import signal
import sys
import termios
import threading
import traceback
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any, TextIO

from head_tracking.exceptions import HeadTrackingError

HINT = "space: STOP"
"""What the status line says where the keys work."""

_STOP = frozenset(b" sS")
_RESUME = frozenset(b"rR")
_PERIOD = 1.0  # s
_SEQUENCE = re.compile(rb"\x1b(\[[0-?]*[ -/]*[@-~]|O.)")  # of an arrow or a function key


class StopKey:
    """Reads single keys as long as the program has its terminal for itself.

    Space or `s` stops, `r` resumes, any other key does nothing. In the background, and while the
    program is suspended, the terminal is left as it was found; so it is at the end, however the
    program ends, except by SIGKILL (`stty sane` helps then; most shells do it by themselves).

    Args:
        stop: relaxes the servos; one line for each, confirmed or not.
        resume: lets them be moved again; lines to show.
        say: shows a line.
        stream: where keys come from; nothing is read if it is no terminal.
    """

    def __init__(
        self,
        stop: Callable[[], Sequence[str]],
        resume: Callable[[], Sequence[str] | None],
        say: Callable[[str], object],
        stream: TextIO | None = None,
    ) -> None:
        self._stop, self._resume, self._say = stop, resume, say
        self._stream = stream or sys.stdin
        self._terminal: int | None = None
        self._found: list[Any] | None = None  # the terminal's settings; None: left as it was
        self._previous: dict[int, Any] = {}
        self._ended = False
        self._ours = threading.Event()
        self._lock = threading.RLock()
        self._thread = threading.Thread(target=self._read, name="stop key", daemon=True)
        self._wake, self._waker = -1, -1

    @property
    def works(self) -> bool:
        """Whether keys are read now."""
        return self._found is not None

    def __enter__(self) -> StopKey:
        """Reads keys from now on; only in the main thread, for signals are heard."""
        self._terminal = _terminal(self._stream)
        if self._terminal is None:
            return self
        self._wake, self._waker = os.pipe()
        for number, handler in (
            (signal.SIGTSTP, self._on_suspend),
            (signal.SIGCONT, self._on_continue),
            (signal.SIGTTIN, signal.SIG_IGN),  # a read that is too late fails instead of stopping
        ):
            if number != signal.SIGTSTP or signal.getsignal(number) != signal.SIG_IGN:
                self._previous[number] = signal.signal(number, handler)
        atexit.register(self._give_back)
        self._take()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._terminal is None:
            return
        self._ended = True
        self._give_back()
        self._ours.set()
        os.write(self._waker, b"x")
        self._thread.join()
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        atexit.unregister(self._give_back)
        os.close(self._wake)
        os.close(self._waker)

    def _take(self) -> None:
        """Has keys sent one by one and unseen, if the terminal is ours now."""
        with self._lock:
            if self._ended or not self._in_foreground():
                return
            assert self._terminal is not None
            try:
                found = self._found or termios.tcgetattr(self._terminal)
                single = termios.tcgetattr(self._terminal)
                single[3] &= ~(termios.ICANON | termios.ECHO)  # Ctrl-C and Ctrl-Z stay signals
                single[6][termios.VMIN], single[6][termios.VTIME] = 0, 0
                # a key that was pressed while the program started counts
                termios.tcsetattr(self._terminal, termios.TCSANOW, single)
            except (termios.error, OSError):
                return  # it has gone
            self._found = found
            self._ours.set()

    def _give_back(self) -> None:
        with self._lock:
            found, self._found = self._found, None
            self._ours.clear()
            if found is None or not self._in_foreground():
                return
            assert self._terminal is not None
            try:
                termios.tcsetattr(self._terminal, termios.TCSANOW, found)
            except (termios.error, OSError):
                return

    def _in_foreground(self) -> bool:
        assert self._terminal is not None
        try:
            return os.tcgetpgrp(self._terminal) == os.getpgrp()
        except OSError:
            return False  # it has gone, or is no longer ours

    def _on_suspend(self, _number: int, _frame: FrameType | None) -> None:
        self._give_back()
        os.kill(os.getpid(), signal.SIGSTOP)  # (goes on below after SIGCONT)
        self._take()

    def _on_continue(self, _number: int, _frame: FrameType | None) -> None:
        self._take()

    def _read(self) -> None:
        assert self._terminal is not None
        while not self._ended:
            if not self._ours.wait(_PERIOD):
                self._take()  # `fg` tells a program that was running already nothing
                continue
            ready, _, _ = select.select([self._terminal, self._wake], [], [])
            if self._terminal in ready:
                self._press(self._keys())

    def _keys(self) -> bytes:
        """What was typed; nothing if the terminal is no longer ours."""
        assert self._terminal is not None
        with self._lock:  # given back meanwhile, it would wait for a whole line
            if self._found is None or not self._in_foreground():
                self._ours.clear()
                return b""
            try:
                return os.read(self._terminal, 64)
            except OSError:
                self._ours.clear()  # it has gone
                return b""

    def _press(self, keys: bytes) -> None:
        keys = _SEQUENCE.sub(b"", keys)
        if not _STOP.isdisjoint(keys):  # a stop wins
            self._do_stop()
        elif not _RESUME.isdisjoint(keys):
            self._do_resume()

    def _do_stop(self) -> None:
        try:
            lines = self._stop()
        except Exception:
            lines = [*traceback.format_exc().splitlines(), "NOT confirmed"]
        self._say("STOP: " + (", ".join(lines) or "no servo is there") + "; r resumes")

    def _do_resume(self) -> None:
        try:
            lines = self._resume() or ()
        except HeadTrackingError as error:
            self._say(f"not resumed: {error}")
            return
        except Exception:
            self._say("\n".join([*traceback.format_exc().splitlines(), "not resumed"]))
            return
        self._say("resumed" + (f": {', '.join(lines)}" if lines else ""))


def _terminal(stream: TextIO | None) -> int | None:
    try:
        return stream.fileno() if stream is not None and stream.isatty() else None
    except (OSError, ValueError):
        return None  # closed
