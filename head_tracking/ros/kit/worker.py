"""A thread for work that takes longer than a callback may: drawing and detecting in images."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_PATIENCE = 3.0  # s that the current work may take at the end


class Worker(Generic[T]):
    """Processes items one at a time in its own thread; of waiting items only the latest one.

    Args:
        name: of the thread.
        work: processes an item.
    """

    def __init__(self, name: str, work: Callable[[T], object]) -> None:
        self._work = work
        self._changed = threading.Condition()
        self._latest: list[T] = []
        self._tasks: deque[Callable[[], object]] = deque()
        self._later: deque[tuple[float, Callable[[], object]]] = deque()
        self._error: Exception | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def offer(self, item: T) -> None:
        """Process this item next, and no item that waits.

        Raises:
            Exception: what ended the thread, so that the caller's node ends too.
        """
        if self._error is not None:
            raise self._error
        with self._changed:
            self._latest = [item]
            self._changed.notify()

    def do(self, task: Callable[[], object]) -> None:
        """Call a task before the next item; tasks keep their order."""
        with self._changed:
            self._tasks.append(task)
            self._changed.notify()

    def later(self, delay: float, task: Callable[[], object]) -> None:
        """Call a task after `delay` [s]; these tasks keep their order, too."""
        with self._changed:
            self._later.append((time.monotonic() + delay, task))
            self._changed.notify()

    def close(self) -> None:
        """Finish the current work and drop the rest."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(_PATIENCE)

    def _run(self) -> None:
        try:
            while (step := self._next()) is not None:
                step()
        except Exception as error:
            self._error = error

    def _next(self) -> Callable[[], object] | None:
        """Wait for the next work and return it; None at the end."""
        with self._changed:
            while not self._closed:
                wait = self._later[0][0] - time.monotonic() if self._later else None
                if wait is not None and wait <= 0.0:
                    return self._later.popleft()[1]
                if self._tasks:
                    return self._tasks.popleft()
                if self._latest:
                    item = self._latest.pop()
                    return lambda: self._work(item)
                self._changed.wait(wait)
            return None
