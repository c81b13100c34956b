"""How well a target was followed."""

from __future__ import annotations

import math


class ErrorStatistics:
    """Root mean square and maximum of an angle [rad]."""

    def __init__(self) -> None:
        self.count = 0
        self.maximum = 0.0
        self._squares = 0.0

    def add(self, error: float) -> None:
        """Takes one error [rad]."""
        self.count += 1
        self.maximum = max(self.maximum, abs(error))
        self._squares += error * error

    @property
    def rms(self) -> float:
        """The root mean square [rad]; 0 without any error taken."""
        return math.sqrt(self._squares / self.count) if self.count else 0.0
