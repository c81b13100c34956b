"""Limits how often a message is logged."""

from __future__ import annotations

import math
import time

_MOST = 100  # subjects; anybody may send targets in frames of any name


class Throttle:
    """Decides which messages are logged: one for each subject within a period [s]."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._logged: dict[str, float] = {}

    def is_due(self, subject: str) -> bool:
        """Return whether a message is to be logged now."""
        now = time.monotonic()
        if now - self._logged.get(subject, -math.inf) < self._period:
            return False
        if len(self._logged) >= _MOST:
            self._logged.clear()
        self._logged[subject] = now
        return True
