"""What the head does when its target stays away: hold, then recentre or search."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from head_tracking.gaze import HeadCommand, PanTiltHead
from head_tracking.parameters import parameter

_ARRIVED = 0.03  # rad


class TargetState(StrEnum):
    """What the head is doing about its target."""

    IDLE = "idle"
    TRACKING = "tracking"
    HOLDING = "holding"
    RECENTERING = "recentering"
    SEARCHING = "searching"


@dataclass(frozen=True, slots=True)
class LostTargetParameters:
    """How long to wait for a lost target, and what to do then."""

    target_timeout: float = parameter(
        1.0,
        "A target not seen for so long is lost: the head stops.",
        unit="s",
        minimum=0.1,
        maximum=60.0,
    )
    recenter_timeout: float = parameter(
        10.0,
        "The head recentres when the target was not seen for so long; 0: never.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    enable_target_search: bool = parameter(False, "Sweep the head to find a lost target again.")
    search_target_timeout: float = parameter(
        10.0,
        "The search starts when the target was not seen for so long.",
        unit="s",
        minimum=0.1,
        maximum=3600.0,
    )
    default_joint_speed: float = parameter(
        0.3, "Speed of recentring and searching.", unit="rad/s", minimum=0.02, maximum=12.0
    )


class LostTargetPolicy:
    """Decides by the time since the last target [s]; before the first one nothing moves."""

    def __init__(self, head: PanTiltHead, parameters: LostTargetParameters) -> None:
        self._head = head
        self.parameters = parameters
        self._seen: float | None = None
        self._held: tuple[float, float] | None = None
        self._sweep = 1.0
        self.state = TargetState.IDLE

    def seen(self, now: float) -> None:
        """A target was there at the time `now`."""
        self._seen, self._held = now, None
        self.state = TargetState.TRACKING

    def forget(self) -> None:
        """Back to before the first target."""
        self._seen, self._held = None, None
        self.state = TargetState.IDLE

    def step(self, present: tuple[float, float], now: float) -> HeadCommand | None:
        """What to do without a target; None while there is one, or nothing to do."""
        p = self.parameters
        if self._seen is None or now - self._seen < p.target_timeout:
            return None
        away = now - self._seen
        if p.enable_target_search and away >= p.search_target_timeout:
            self.state = TargetState.SEARCHING
            return self._search(present)
        if 0 < p.recenter_timeout <= away:
            return self._recenter(present)
        self.state = TargetState.HOLDING
        if self._held is None:
            self._held = present
        return self._slowly(self._held)

    @property
    def _centre(self) -> tuple[float, float]:
        return self._head.pan_limits.clamp(0.0), self._head.tilt_limits.clamp(0.0)

    def _recenter(self, present: tuple[float, float]) -> HeadCommand | None:
        centred = all(abs(a - b) < _ARRIVED for a, b in zip(present, self._centre, strict=True))
        if not centred:
            self.state = TargetState.RECENTERING
            return self._slowly(self._centre)
        self.state = TargetState.IDLE
        if not self.parameters.enable_target_search:
            self._seen = None
        return None

    def _search(self, present: tuple[float, float]) -> HeadCommand:
        limits = self._head.pan_limits
        reach = (max(limits.lower, -3.0), min(limits.upper, 3.0))
        edge = reach[1] if self._sweep > 0 else reach[0]
        if abs(present[0] - edge) < _ARRIVED:
            self._sweep = -self._sweep
            edge = reach[1] if self._sweep > 0 else reach[0]
        return self._slowly((edge, self._centre[1]))

    def _slowly(self, goal: tuple[float, float]) -> HeadCommand:
        speed = self.parameters.default_joint_speed
        return HeadCommand(*goal, speed, speed)
