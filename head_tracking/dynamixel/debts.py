"""Which servos may still send an answer that nobody waits for any more."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

_FORGOTTEN: Final = 1.0
"""Seconds after which no answer is still on its way, through whatever adapter."""

_MOST: Final = 24  # bytes


class Debts:
    """Answers that did not come in time, by protocol and id, and their lengths.

    Args:
        clock: Monotonic time, s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._since: dict[tuple[int, int], dict[int, float]] = {}

    def __bool__(self) -> bool:
        return bool(self._since)

    def add(self, protocol: int, servo_id: int, length: int) -> None:
        """Note that an answer with so many bytes of data may still come."""
        self._since.setdefault((protocol, servo_id), {})[length] = self._clock()

    def extra(self, protocol: int, ids: Iterable[int], length: int) -> int | None:
        """Return how many bytes more to ask for, so that no late answer has the length of the new.

        Returns:
            That number; None if there is none, after many failures in a second.
        """
        if not self._since:
            return 0
        owed: set[int] = set()
        for servo_id in ids:
            owed |= self._lengths(protocol, servo_id)
        return next((extra for extra in range(_MOST + 1) if length + extra not in owed), None)

    def pay(self, protocol: int, servo_id: int, length: int) -> float | None:
        """Note that such an answer has come; return how late it is, s, or None if none is owed."""
        owed = self._since.get((protocol, servo_id))
        if owed is None:
            return None
        since = owed.pop(length, None)
        if not owed:
            del self._since[protocol, servo_id]
        return None if since is None else self._clock() - since

    def _lengths(self, protocol: int, servo_id: int) -> set[int]:
        """Return how long the answers are that may still come from a servo."""
        key = (protocol, servo_id)
        owed = self._since.get(key)
        if owed is None:
            return set()
        now = self._clock()
        recent = {length: since for length, since in owed.items() if now - since <= _FORGOTTEN}
        if recent:
            self._since[key] = recent
        else:
            del self._since[key]
        return set(recent)
