"""Estimates of servos and camera, with their deviations."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from head_tracking.compatibility import StrEnum
from head_tracking.parameters import parameter


class Learning(StrEnum):
    """What happens to the estimates: update, keep, or discard once and update."""

    LEARN = "learn"
    FREEZE = "freeze"
    FORGET = "forget"


_ESTIMATED = -0.2  # s; a `camera_delay` that gives none
_MODES = "learn, freeze (use and keep what was learned) or forget (discard it and learn anew)."


@dataclass(frozen=True, slots=True)
class LearningParameters:
    """What tracking learns, and the values that are given instead."""

    servo_learning: str = parameter(
        Learning.LEARN.value,
        f"What tracking learns of the servos: {_MODES}",
        choices=tuple(Learning),
    )
    camera_learning: str = parameter(
        Learning.LEARN.value,
        f"What tracking learns of a camera on the head: {_MODES}",
        choices=tuple(Learning),
    )
    servo_delay: float = parameter(
        0.0,
        "Time from a command to the motion it causes; 0: estimated while the head moves.",
        unit="s",
        minimum=0.0,
        maximum=0.35,
    )
    servo_dead_band: float = parameter(
        0.0,
        "How far a servo stays behind its goal; 0: estimated while the head moves.",
        unit="rad",
        minimum=0.0,
        maximum=0.05,
    )
    servo_acceleration: float = parameter(
        0.0,
        "How hard a servo accelerates its joint; 0: estimated while the head moves.",
        unit="rad/s^2",
        minimum=0.0,
        maximum=500.0,
    )
    camera_delay: float = parameter(
        _ESTIMATED,
        "By how much the stamps of a camera on the head are too late; 0: they are right; "
        f"{_ESTIMATED:g}: estimated while the head moves.",
        unit="s",
        minimum=_ESTIMATED,
        maximum=0.9,
    )

    @property
    def has_camera_delay(self) -> bool:
        """Whether the camera's delay is given."""
        return self.camera_delay > _ESTIMATED


_UNITS = (86_400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s")
KNOWN = 0.04  # s; largest deviation of a delay that counts as known


@dataclass(frozen=True, slots=True)
class ServoValues:
    """Estimates of a servo that are saved for the next run.

    The acceleration is not saved: a head with a low estimate moves so slowly that it would never
    correct it.

    Attributes:
        delay: from a command to the motion it causes [s].
        deviation: standard deviation of the delay [s].
        dead_band: how far the shaft stays behind the set-point [rad]; None: not observed.
        saved: when they were saved [s, as time.time()]; -inf: not yet.
    """

    delay: float
    deviation: float
    dead_band: float | None
    saved: float = field(default=-math.inf, compare=False)


@dataclass(frozen=True, slots=True)
class LearnedValue:
    """An estimate, or a value given by the user.

    Attributes:
        value: as it is used, in `unit`.
        unit: s, rad or rad/s^2.
        deviation: standard deviation, in `unit`; inf: not estimated.
        learned: time of the last update, on the clock of the stamps [s]; of a saved value, when it
            was saved; -inf: never.
        known: with a larger deviation the value counts as unknown.
        is_given: whether the user has given it.
        is_saved: whether it comes from an earlier run and was not updated in this one.
        is_frozen: whether measurements do not change it.
    """

    value: float
    unit: str
    deviation: float = 0.0
    learned: float = -math.inf
    known: float = math.inf
    is_given: bool = False
    is_saved: bool = False
    is_frozen: bool = False

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
        text = f"{self.value:.3g} {self.unit}, {self.source}"
        if self.source in ("learned", "saved"):
            age = _age(now - self.learned)
            text = f"{self.value:.3g} ±{self.deviation:.2g} {self.unit}, {self.source}{age}"
        return f"{text}, frozen" if self.is_frozen and not self.is_given else text


def _age(seconds: float) -> str:
    """Return an age as text; empty: it is not known."""
    if not 0.0 <= seconds < math.inf:
        return ""
    size, unit = next((each for each in _UNITS if seconds >= 2.0 * each[0]), _UNITS[-1])
    return f" {seconds / size:.0f} {unit} ago"
