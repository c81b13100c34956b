"""What a head learns while it tracks: how late its servos and its camera are."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.compatibility import StrEnum


class Learning(StrEnum):
    """What becomes of learned values: they are learned, kept as they are, or forgotten."""

    LEARN = "learn"
    FREEZE = "freeze"
    FORGET = "forget"


_KNOWN = 0.04  # s; with a larger deviation nothing is known


@dataclass(frozen=True, slots=True)
class LearnedValue:
    """A time that is learned, or given by hand.

    Attributes:
        value: as it is used [s].
        deviation: standard deviation of what was learned [s].
        learned: when something was learned of it last, on the clock of the stamps [s]; -inf: never.
        is_given: whether it is given by hand.
    """

    value: float
    deviation: float = 0.0
    learned: float = -math.inf
    is_given: bool = False

    @property
    def source(self) -> str:
        """Where it comes from: "given", "learned", or "not observable" as yet."""
        if self.is_given:
            return "given"
        return "learned" if self.deviation < _KNOWN else "not observable"

    def told(self, now: float) -> str:
        """Return it for a person, with its deviation and its age at the time `now` [s]."""
        text = f"{1e3 * self.value:.1f} ms, {self.source}"
        if self.source == "learned":
            text = f"{1e3 * self.value:.1f} ±{1e3 * self.deviation:.1f} ms, {self.source}"
            if self.learned > -math.inf:
                text += f" {now - self.learned:.0f} s ago"
        return text
