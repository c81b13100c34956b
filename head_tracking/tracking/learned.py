"""Estimates of servos and camera, with their deviations."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.compatibility import StrEnum


class Learning(StrEnum):
    """Mode of the estimates: update, keep or discard."""

    LEARN = "learn"
    FREEZE = "freeze"
    FORGET = "forget"


KNOWN = 0.04  # s; largest deviation of a delay that counts as known


@dataclass(frozen=True, slots=True)
class ServoValues:
    """Estimates of a servo that are saved for the next run.

    The acceleration is not saved: a head with a low estimate moves so slowly that it would never
    correct it.

    Attributes:
        delay: from a command to the motion it causes [s].
        deviation: standard deviation of the delay [s].
        dead_band: how far the shaft stays behind the set-point [rad].
    """

    delay: float
    deviation: float
    dead_band: float


@dataclass(frozen=True, slots=True)
class LearnedValue:
    """An estimate, or a value given by the user.

    Attributes:
        value: as it is used, in `unit`.
        unit: s, rad or rad/s^2.
        deviation: standard deviation, in `unit`; inf: not estimated.
        learned: time of the last update, on the clock of the stamps [s]; -inf: never.
        known: with a larger deviation the value counts as unknown.
        is_given: whether the user has given it.
        is_saved: whether it comes from an earlier run and was not updated in this one.
    """

    value: float
    unit: str
    deviation: float = 0.0
    learned: float = -math.inf
    known: float = math.inf
    is_given: bool = False
    is_saved: bool = False

    @property
    def source(self) -> str:
        """Its source: "given", "saved", "learned", or "not observable"."""
        if self.is_given:
            return "given"
        if self.is_saved:
            return "saved"
        return "learned" if self.deviation < self.known else "not observable"

    def described(self, now: float) -> str:
        """Return the value as text, with its deviation and its age at the time `now` [s]."""
        if self.source not in ("learned", "saved"):
            return f"{self.value:.3g} {self.unit}, {self.source}"
        text = f"{self.value:.3g} ±{self.deviation:.2g} {self.unit}, {self.source}"
        age = now - self.learned
        return f"{text} {age:.0f} s ago" if 0.0 <= age < math.inf else text
