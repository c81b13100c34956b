"""Waiting for what another thread or process does."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

PATIENCE = 10.0  # s
T = TypeVar("T")


class _Failing(Protocol):
    @property
    def failure(self) -> Exception | None: ...


_watched: list[_Failing] = []


@contextmanager
def failing_waits(threads: _Failing) -> Iterator[None]:
    """Let every wait raise the failure of these threads at once."""
    _watched.append(threads)
    try:
        yield
    finally:
        _watched.remove(threads)


def _raise_failure() -> None:
    for threads in _watched:
        if threads.failure is not None:
            raise threads.failure


def eventually(condition: Callable[[], bool]) -> bool:
    """Whether it becomes true before long."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def wait_for(what: Callable[[], T], patience: float = 3 * PATIENCE) -> T:
    """Polls until `what` gives something true; what it gave."""
    deadline = time.monotonic() + patience
    while not (found := what()):
        _raise_failure()
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {patience} s in vain; last answer: {found!r}")
        time.sleep(0.01)
    return found
