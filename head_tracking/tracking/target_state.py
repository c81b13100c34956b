"""The target state machine: what the head does, from before the first target to after the last."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from head_tracking.gaze import Gaze, GazeStatus, PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.tracking.laws import inside
from head_tracking.tracking.search import Sweep

_ARRIVED = 0.03  # rad
_ON_TARGET = 0.035  # rad: 2 degrees
_OFF_TARGET = 0.1  # rad; hysteresis: so far off, for so long, the head is on the target no more
_OFF_TIME = 0.3  # s
_USUAL_INTERVAL = 0.1  # s between points, until they have shown their own
_MISSED = 3.0  # intervals without a point: it is missed
_REFUSAL_SHOWN = 2.0  # s


class TargetState(StrEnum):
    """What the head is doing about its target."""

    DISABLED = "disabled"
    IDLE = "idle"
    ACQUIRING = "acquiring"
    TRACKING = "tracking"
    AT_LIMIT = "at the limit"
    COASTING = "coasting"
    HOLDING = "holding"
    RECENTERING = "recentering"
    SEARCHING = "searching"
    STALLED = "stalled"


@dataclass(frozen=True, slots=True)
class TargetStateParameters:
    """What to do when the target stays away; how long it is waited for is the estimator's."""

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


class TargetStateMachine:
    """Decides by the time since the last point [s]; before the first one nothing moves.

    That it was switched off, that targets are refused and that the servos do not follow are facts
    of their own: no transition takes them away.

    Attributes:
        parameters: may change at any time.
        enabled: targets are followed.
        off: why not, while they are not.
        refusal: why a target has led to nothing lately; empty if none has.
        stalled: which joints do not do what they are told, and why that may be; empty: they do.
    """

    def __init__(self, head: PanTiltHead, parameters: TargetStateParameters) -> None:
        self.parameters = parameters
        self.enabled, self.off = True, "tracking is switched off"
        self.stalled = ""
        self._state = TargetState.IDLE
        self._reason = "no target has come yet"
        self.refusal, self._refused = "", 0.0
        self._head = head
        self._sweep = Sweep(head)
        self._seen: float | None = None
        self._on_target = 0.0
        self._interval = _USUAL_INTERVAL
        self._held: tuple[float, float] | None = None
        self._centring = False

    @property
    def state(self) -> TargetState:
        """What the head does, by what its servos do."""
        if not self.enabled:
            return TargetState.DISABLED
        return TargetState.STALLED if self.stalled else self._state

    @property
    def reason(self) -> str:
        """Why."""
        if not self.enabled:
            return self.off
        reason = self.stalled or self._reason
        return f"{reason}; targets are refused: {self.refusal}" if self.refusal else reason

    def enable(self, on: bool) -> None:
        """Targets are followed from now on, or not."""
        self.enabled = on
        self.forget("tracking was switched on; no target has come since")

    def seen(self, now: float, *, new: bool) -> None:
        """A point was taken at the time `now` [s]; it may be the first one of a new target."""
        if self._seen is not None and not new:
            interval = min(now - self._seen, 10.0 * self._interval)
            self._interval += 0.1 * (interval - self._interval)
        if new:
            self._become(TargetState.ACQUIRING, "a new target has come")
        if now - self._refused > _REFUSAL_SHOWN:
            self.refusal = ""
        self._seen, self._held, self._centring = now, None, False

    def refused(self, reason: str, now: float) -> None:
        """A target has led to nothing, and why; a new reason has to wait until one was read."""
        if not self.refusal or now - self._refused > 0.5 * _REFUSAL_SHOWN:
            self.refusal, self._refused = reason, now

    def forget(self, reason: str) -> None:
        """Back to before the first target."""
        self._seen = self._held = None
        self._centring = False
        self.refusal = self.stalled = ""
        self._become(TargetState.IDLE, reason)

    def recenter(self) -> None:
        """The head goes back to its centre; the next target is followed again."""
        self.forget("")
        self._centring = True
        self._become(TargetState.RECENTERING, "as requested")

    def follows(self, now: float, timeout: float) -> bool:
        """Whether the target, or the prediction of where it is, is followed now."""
        return self._seen is not None and now - self._seen < timeout

    def followed(self, gaze: Gaze, error: float, now: float) -> None:
        """The target was followed; `error` [rad] is by how much the head misses it."""
        assert self._seen is not None
        if error < _OFF_TARGET:
            self._on_target = now
        away = now - self._seen
        if away > _MISSED * self._interval:
            self._become(TargetState.COASTING, "no point comes; the prediction is followed")
        elif gaze.status is not GazeStatus.REACHED:
            self._become(TargetState.AT_LIMIT, gaze.reason)
        elif error < _ON_TARGET:
            self._become(TargetState.TRACKING, "the head is on the target")
        elif self._state is not TargetState.TRACKING or now - self._on_target > _OFF_TIME:
            self._become(TargetState.ACQUIRING, "the head turns to the target")

    def goal(self, positions: tuple[float, float], now: float) -> tuple[float, float] | None:
        """Where to turn without a target [rad]; None: the head is left alone.

        Args:
            positions: pan and tilt as they are [rad].
            now: the time [s].
        """
        p = self.parameters
        away = None if self._seen is None else now - self._seen
        if self._centring:
            return self._recentring(positions)
        if away is None:
            return None
        lost = "no target was seen for {:g} s"
        if p.enable_target_search and away >= p.search_target_timeout:
            self._become(TargetState.SEARCHING, lost.format(p.search_target_timeout))
            return self._sweep.goal(positions)
        if 0.0 < p.recenter_timeout <= away and self._state is not TargetState.IDLE:
            self._become(TargetState.RECENTERING, lost.format(p.recenter_timeout))
            return self._recentring(positions)
        if self._state is TargetState.IDLE:
            return None
        self._become(TargetState.HOLDING, "the target is lost")
        self._held = self._held or inside(self._head, positions)
        return self._held

    def _recentring(self, positions: tuple[float, float]) -> tuple[float, float] | None:
        centre = self._head.pan_limits.clamp(0.0), self._head.tilt_limits.clamp(0.0)
        if any(abs(a - b) >= _ARRIVED for a, b in zip(positions, centre, strict=True)):
            return centre
        self._centring = False
        self._become(TargetState.IDLE, "the head is at its centre")
        return None

    def _become(self, state: TargetState, reason: str) -> None:
        self._state, self._reason = state, reason
