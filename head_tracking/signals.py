"""Signals that end a program which drives servos."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ENDING = [signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
_ONCE = 1.0  # s


@contextmanager
def ending_signals() -> Iterator[None]:
    """Raise KeyboardInterrupt at signals that would end the process and leave servos as they are.

    Further ones within a second would interrupt what relaxes the servos, and are ignored. Signals
    that were ignored before stay ignored: nohup does that.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    raised = -math.inf

    def interrupt(number: int, _frame: FrameType | None) -> None:
        nonlocal raised
        now = time.monotonic()
        if now - raised > _ONCE:
            raised = now
            raise KeyboardInterrupt(number)

    handled = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in handled:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in handled:
            if signal.getsignal(number) is interrupt:  # else the program has set another handler
                signal.signal(number, signal.SIG_DFL)


@contextmanager
def postponed_signals() -> Iterator[None]:
    """Postpone Ctrl-C and the signals that end the process to the end of the block.

    They could leave servos with torque on, or a lock locked.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *_ENDING)}
    handlers = {n: each for n, each in before.items() if each not in (None, signal.SIG_IGN)}
    for number in handlers:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for each in dict.fromkeys(came):
            signal.raise_signal(each)
