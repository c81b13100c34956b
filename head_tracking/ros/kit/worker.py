"""A thread beside the executor's, for what takes longer than a callback may: images."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_PATIENCE = 3.0  # s that what is under way at the end may take


class Worker(Generic[T]):
    """Works on the newest thing it was given, one at a time, in a thread of its own.

    Args:
        name: of the thread.
        work: what is done with each thing; one that nobody had time for is left out.
    """

    def __init__(self, name: str, work: Callable[[T], object]) -> None:
        self._work = work
        self._changed = threading.Condition()
        self._newest: list[T] = []
        self._tasks: deque[Callable[[], object]] = deque()
        self._later: deque[tuple[float, Callable[[], object]]] = deque()
        self._error: Exception | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def offer(self, thing: T) -> None:
        """Works on it next; on nothing that was given before.

        Raises:
            Exception: what ended the thread, so that it ends the node too.
        """
        if self._error is not None:
            raise self._error
        with self._changed:
            self._newest = [thing]
            self._changed.notify()

    def do(self, task: Callable[[], object]) -> None:
        """Does something before the next thing, in the order of the calls."""
        with self._changed:
            self._tasks.append(task)
            self._changed.notify()

    def later(self, delay: float, task: Callable[[], object]) -> None:
        """Does something after `delay` [s], and after all that was to be done later before."""
        with self._changed:
            self._later.append((time.monotonic() + delay, task))
            self._changed.notify()

    def close(self) -> None:
        """Ends what is under way, leaves out the rest."""
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
        """What is to be done now, as soon as there is something; None at the end."""
        with self._changed:
            while not self._closed:
                wait = self._later[0][0] - time.monotonic() if self._later else None
                if wait is not None and wait <= 0.0:
                    return self._later.popleft()[1]
                if self._tasks:
                    return self._tasks.popleft()
                if self._newest:
                    thing = self._newest.pop()
                    return lambda: self._work(thing)
                self._changed.wait(wait)
            return None
