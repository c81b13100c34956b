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
        self._due: dict[tuple[int, int], dict[int, float]] = {}

    def __bool__(self) -> bool:
        return bool(self._due)

    @property
    def protocols(self) -> set[int]:
        """Protocols of the answers that may still come."""
        return {protocol for protocol, _ in self._due}

    def add(self, protocol: int, servo_id: int, length: int, due: float) -> None:
        """Note that an answer with so many bytes of data, due at a time, s, may still come."""
        self._due.setdefault((protocol, servo_id), {})[length] = due

    def forget(self) -> None:
        """Drop what is too old to come."""
        now = self._clock()
        for key, owed in list(self._due.items()):
            recent = {length: due for length, due in owed.items() if now - due <= _FORGOTTEN}
            if recent:
                self._due[key] = recent
            else:
                del self._due[key]

    def extra(self, protocol: int, ids: Iterable[int], length: int) -> int | None:
        """Return how many bytes more to ask for, so that no late answer has the length of the new.

        Returns:
            That number; None if there is none, after many failures in a second.
        """
        if not self._due:
            return 0
        self.forget()
        owed: set[int] = set()
        for servo_id in ids:
            owed.update(self._due.get((protocol, servo_id), ()))
        return next((extra for extra in range(_MOST + 1) if length + extra not in owed), None)

    def pay(self, protocol: int, servo_id: int, length: int) -> float | None:
        """Note that such an answer has come; return how late it is, s, or None if none is owed."""
        owed = self._due.get((protocol, servo_id))
        if owed is None:
            return None
        due = owed.pop(length, None)
        if not owed:
            del self._due[protocol, servo_id]
        return None if due is None else self._clock() - due
