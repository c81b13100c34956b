"""A tracker with ideal servos: each joint moves at the commanded speed to its goal."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from head_tracking.gaze import HeadCommand
from head_tracking.tracking import Tracker, TrackingStep

DT = 0.02


class IdealHead:
    """Runs a tracker, period by period.

    Args:
        tracker: the tracker.
        now: the time at the start [s].
        late: periods from a command to its effect.
        tick: resolution of the encoders [rad]; 0: exact.

    Attributes:
        now: may be set, as a clock that jumps.
        positions: of pan and tilt [rad].
        obeys: whether the servos move.
        farthest: the longest way of a joint in one period [rad]; may be reset.
        step: the result of the last period.
    """

    def __init__(
        self, tracker: Tracker, now: float = 100.0, late: int = 0, tick: float = 0.0
    ) -> None:
        self.tracker, self.now, self.positions = tracker, now, (0.0, 0.0)
        self.obeys, self.farthest, self.step = True, 0.0, TrackingStep()
        self._tick = tick
        self._command: HeadCommand | None = None
        self._pending: deque[HeadCommand | None] = deque([None] * late)

    def run(self, seconds: float, target: Any = None) -> IdealHead:
        """Run for some time [s]; `target` is seen at once, in the head's base frame [m]."""
        for _ in range(round(seconds / DT)):
            self.now += DT
            self.measure()
            if target is not None:
                self.tracker.target_seen(self.now, target, self.now)
            self.step = self.tracker.step(self.now)
            self.obey(self.step.command)
        return self

    def measure(self) -> tuple[float, float]:
        """Pass the measured positions to the tracker, and return them [rad]."""
        pan, tilt = self.positions
        if self._tick:
            pan, tilt = (self._tick * round(angle / self._tick) for angle in (pan, tilt))
        self.tracker.joints_read(self.now, (pan, tilt))
        return pan, tilt

    def obey(self, command: HeadCommand | None) -> None:
        """Move the joints for a period."""
        self._pending.append(command)
        self._command = c = self._pending.popleft() or self._command
        if c is None or not self.obeys:
            return
        moved = []
        for here, goal, speed in zip(
            self.positions, (c.pan, c.tilt), (c.pan_speed, c.tilt_speed), strict=True
        ):
            way = math.copysign(min(abs(goal - here), speed * DT), goal - here)
            self.farthest = max(self.farthest, abs(way))
            moved.append(here + way)
        self.positions = moved[0], moved[1]
