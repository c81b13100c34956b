"""Signals that end a program which drives servos."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_ENDING = [signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
_ONCE = 1.0  # s


@contextmanager
def ending_signals(*others: signal.Signals) -> Iterator[None]:
    """Raise KeyboardInterrupt at signals that would end the process and leave servos as they are.

    Further ones within a second would interrupt what relaxes the servos, and are ignored. Signals
    that were ignored before stay ignored: nohup does that. They end forks of the process, such as
    the workers of a pool.

    Args:
        others: further signals, such as SIGINT, which Python handles in the same way each time.
    """
    raised, process = -math.inf, os.getpid()

    def interrupt(number: int, _frame: FrameType | None) -> None:
        nonlocal raised
        if os.getpid() != process:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        now = time.monotonic()
        if now - raised > _ONCE:
            raised = now
            raise KeyboardInterrupt(number)

    usual = signal.SIG_DFL, signal.default_int_handler
    unhandled = [number for number in (*others, *_ENDING) if signal.getsignal(number) in usual]
    with _handled(unhandled, interrupt):
        yield


@contextmanager
def postponed_signals() -> Iterator[None]:
    """Postpone Ctrl-C and the signals that end the process to the end of the block.

    They could leave servos with torque on, or a lock locked.
    """
    came: dict[int, None] = {}
    numbers = [
        number
        for number in (signal.SIGINT, *_ENDING)
        if signal.getsignal(number) not in (None, signal.SIG_IGN)
    ]
    try:
        with _handled(numbers, lambda number, _: came.setdefault(number)):
            yield
    finally:
        for number in came:
            signal.raise_signal(number)


@contextmanager
def _handled(
    numbers: list[signal.Signals], handler: Callable[[int, FrameType | None], object]
) -> Iterator[None]:
    """Handle signals in the block; outside of the main thread nothing can be handled."""
    is_main = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, handler) for number in numbers if is_main}
    try:
        yield
    finally:
        for number, previous in before.items():
            if signal.getsignal(number) is handler:  # else the program has set another handler
                signal.signal(number, previous)
