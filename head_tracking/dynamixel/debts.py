"""Which servos may still send an answer that nobody waits for any more."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

_FORGOTTEN: Final = 1.0
"""Seconds after which no answer is still on its way, through whatever adapter."""


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

    def owes(self, protocol: int, servo_id: int) -> bool:
        """Return whether a servo owes any answer."""
        return (protocol, servo_id) in self._since

    def lengths(self, protocol: int, servo_id: int) -> frozenset[int]:
        """Return how long the answers are that may still come from a servo."""
        key = (protocol, servo_id)
        owed = self._since.get(key)
        if owed is None:
            return frozenset()
        now = self._clock()
        recent = {length: since for length, since in owed.items() if now - since <= _FORGOTTEN}
        if recent:
            self._since[key] = recent
        else:
            del self._since[key]
        return frozenset(recent)

    def pay(self, protocol: int, servo_id: int, length: int) -> float | None:
        """Note that such an answer has come; return how late it is, s, or None if none is owed."""
        owed = self._since.get((protocol, servo_id), {})
        since = owed.pop(length, None)
        if not owed:
            self._since.pop((protocol, servo_id), None)
        return None if since is None else self._clock() - since

    def forgive(self, protocol: int, servo_id: int) -> None:
        """Note that nothing older can come from a servo: it has answered a later question."""
        self._since.pop((protocol, servo_id), None)
