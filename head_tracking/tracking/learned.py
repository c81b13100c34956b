"""What a head learns while it tracks: of its servos, and how late its camera is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.compatibility import StrEnum


class Learning(StrEnum):
    """What becomes of learned values: they are learned, kept as they are, or forgotten."""

    LEARN = "learn"
    FREEZE = "freeze"
    FORGET = "forget"


KNOWN = 0.04  # s; of a delay with a larger deviation nothing is known


@dataclass(frozen=True, slots=True)
class ServoValues:
    """What a run has learned of a servo, for the next one.

    How hard the servo accelerates is not among it: a head that believes in a weak servo moves so
    gently that it never finds out how strong the servo is.

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
    """A value that is learned, or given by hand.

    Attributes:
        value: as it is used, in `unit`.
        unit: s, rad or rad/s^2.
        deviation: standard deviation of what was learned, in `unit`; inf: nothing was.
        learned: when something was learned of it last, on the clock of the stamps [s]; -inf: never.
        known: with a larger deviation nothing is known.
        is_given: whether it is given by hand.
        is_saved: whether it was learned in an earlier run, and nothing of it in this one.
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
        """Where it comes from: "given", "saved", "learned", or "not observable" as yet."""
        if self.is_given:
            return "given"
        if self.is_saved:
            return "saved"
        return "learned" if self.deviation < self.known else "not observable"

    def described(self, now: float) -> str:
        """Return it for a person, with its deviation and its age at the time `now` [s]."""
        if self.source not in ("learned", "saved"):
            return f"{self.value:.3g} {self.unit}, {self.source}"
        text = f"{self.value:.3g} ±{self.deviation:.2g} {self.unit}, {self.source}"
        age = now - self.learned
        return f"{text} {age:.0f} s ago" if 0.0 <= age < math.inf else text
