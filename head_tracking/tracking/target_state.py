"""The target state machine: what the head does before, with and without a target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from head_tracking.compatibility import StrEnum
from head_tracking.gaze import Gaze, GazeStatus, PanTiltHead, at_goal
from head_tracking.parameters import parameter
from head_tracking.tracking.law import inside
from head_tracking.tracking.search import Sweep

_ON_TARGET = 0.035  # rad: 2 degrees
_OFF_TARGET = 0.1  # rad; hysteresis: with a larger error for `_OFF_TIME` the head is off target
_OFF_TIME = 0.3  # s
_USUAL_INTERVAL = 0.1  # s between points, until it is measured
_MISSED = 3.0  # intervals after which a point is overdue
_REFUSAL_SHOWN = 2.0  # s


class TargetState(StrEnum):
    """The states of a head that follows targets."""

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
    """What the head does without a target; `target_timeout` is a parameter of the estimator."""

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
    """Decide by the time since the last point [s]; before the first point nothing moves.

    `refusal` and `stalled` are independent of the state: transitions do not change them.

    Attributes:
        parameters: may change at any time.
        refusal: why a recent target was refused; empty: none was.
        stalled: which joints do not follow their commands; empty: all follow.
    """

    def __init__(self, head: PanTiltHead, parameters: TargetStateParameters) -> None:
        self.parameters = parameters
        self.stalled = ""
        self._state = TargetState.IDLE
        self._reason = "no target has come yet"
        self.refusal, self._refused = "", 0.0
        self._not_taken = ""
        self._head = head
        self._sweep = Sweep(head)
        self._seen: float | None = None
        self._on_target = 0.0
        self._interval = _USUAL_INTERVAL
        self._centring = False

    @property
    def state(self) -> TargetState:
        """The present state."""
        return TargetState.STALLED if self.stalled else self._state

    @property
    def reason(self) -> str:
        """The reason for the state, a sentence."""
        reason = self.stalled or self._reason
        return f"{reason}; a target was refused: {self.refusal}" if self.refusal else reason

    def seen(self, now: float, *, new: bool) -> None:
        """Record that a point was used at the time `now` [s], perhaps the first of a new target."""
        if self._seen is not None and not new:
            interval = min(now - self._seen, 10.0 * self._interval)
            self._interval += 0.1 * (interval - self._interval)
        if new:
            self._become(TargetState.ACQUIRING, "a new target has come")
        if now - self._refused > _REFUSAL_SHOWN:
            self.refusal = ""
        self._seen, self._centring = now, False

    def refused(self, reason: str, now: float) -> None:
        """Record why a target was refused; `refusal` is kept for 1 s before another replaces it."""
        self._not_taken = reason
        if not self.refusal or now - self._refused > 0.5 * _REFUSAL_SHOWN:
            self.refusal, self._refused = reason, now

    def take_refusal(self) -> str:
        """Return why a target was refused since the last call; empty: none was."""
        reason, self._not_taken = self._not_taken, ""
        return reason

    def forget(self, reason: str) -> None:
        """Return to the state before the first target."""
        self._seen = None
        self._centring = False
        self.refusal = self.stalled = ""
        self._become(TargetState.IDLE, reason)

    def recenter(self) -> None:
        """Turn the head to its centre; the next target is followed."""
        self.forget("")
        self._centring = True
        self._become(TargetState.RECENTERING, "as requested")

    def follows(self, now: float, timeout: float) -> bool:
        """Return whether the target, or its prediction, is followed now."""
        return self._seen is not None and now - self._seen < timeout

    def followed(self, gaze: Gaze, error: float, now: float) -> None:
        """Record that the target was followed; the head misses it by `error` [rad]."""
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

    def goal(
        self,
        positions: tuple[float, float],
        waiting: Callable[[], tuple[float, float] | None],
        now: float,
    ) -> tuple[float, float] | None:
        """Return where to turn without a target [rad]; None: send nothing.

        Args:
            positions: present pan and tilt [rad].
            waiting: returns pan and tilt that look at where the lost target should be [rad]; None:
                that is unknown.
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
        place = waiting()
        return None if place is None else inside(self._head, place)

    def _recentring(self, positions: tuple[float, float]) -> tuple[float, float]:
        centre = self._head.pan_limits.clamp(0.0), self._head.tilt_limits.clamp(0.0)
        if at_goal(positions, centre):  # commanded even so: the servos may have another goal
            self._centring = False
            self._become(TargetState.IDLE, "the head is at its centre")
        return centre

    def _become(self, state: TargetState, reason: str) -> None:
        self._state, self._reason = state, reason
