"""Waiting for what another thread or process does."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

PATIENCE = 120.0  # s: other tests may keep the machine busy, and the page has low priority
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


def join(*threads: threading.Thread) -> None:
    """Wait until threads have ended."""
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive(), f"{thread.name} does not end"


@contextmanager
def repeating(*works: Callable[[], object], period: float = 0.0) -> Iterator[None]:
    """Call functions again and again, each in a thread of its own, with a pause [s]."""
    ending = threading.Event()

    def repeat(work: Callable[[], object]) -> None:
        while not ending.wait(period):
            work()

    threads = [threading.Thread(target=repeat, args=(work,), daemon=True) for work in works]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ending.set()
        join(*threads)


def wait_for(
    what: Callable[[], T],
    patience: float = PATIENCE,
    interval: float = 0.01,
    why: Callable[[], object] = str,
) -> T:
    """Polls until `what` gives something true; what it gave. `why` may say more of a failure."""
    deadline = time.monotonic() + patience
    while not (found := what()):
        for failure in filter(None, (threads.failure for threads in _watched)):
            raise failure
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {patience} s in vain; last answer: {found!r} {why()}")
        time.sleep(interval)
    return found


def at_rest(positions: Callable[[], tuple[float, float]], seconds: float) -> tuple[float, float]:
    """Wait until pan and tilt have stood still for a while [s]; return them [rad]."""
    seen: deque[tuple[float, float]] = deque(maxlen=round(100 * seconds))

    def still() -> bool:
        seen.append(positions())
        return len(seen) == seen.maxlen and all(
            max(each) - min(each) < 1e-3 for each in zip(*seen, strict=True)
        )

    wait_for(still)
    return seen[-1]
