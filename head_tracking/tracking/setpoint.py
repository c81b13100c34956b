"""Commands for servos as a stream of positions, for a head that somebody else's controller drives.

A goal and a speed, as a servo takes them, say where the servo's setpoint goes. Here that setpoint
is kept, and where it will be a moment later is said again and again, until it is at its goal.
"""

from __future__ import annotations

import math

from head_tracking.gaze import HeadCommand

_NEAR = 0.05  # rad; a joint that rests so near to its setpoint is where it was told to be
_PAUSE = 0.2  # s; after a longer one a setpoint starts where the joint is
_GAP, _GAP_TIME = 0.1, 0.3  # rad, s: so far, and so far in time, a setpoint runs before its joint
_LEAD = 0.03  # s; so much earlier, because a servo comes so late after a position it is told
_DUE = 0.9  # of a period


class SetpointStream:
    """The setpoints of pan and tilt. Times are in seconds, on any clock, and go on.

    Args:
        period: between two positions of the stream [s].
        ahead: how long a position has to be reached [s].
    """

    def __init__(self, period: float, ahead: float) -> None:
        self._period = period
        self._ahead = max(period, ahead) + _LEAD
        self._joints: tuple[_Setpoint, _Setpoint] | None = None
        self._told = -math.inf

    @property
    def active(self) -> bool:
        """Whether something was said since `stop`."""
        return self._joints is not None

    def stop(self) -> None:
        """Says nothing any more."""
        self._joints = None

    def positions(
        self, command: HeadCommand | None, measured: tuple[float, float], now: float
    ) -> tuple[float, float] | None:
        """Where pan and tilt shall be told to be [rad]; None: there is nothing to say now.

        Args:
            command: a new one; None: the last one counts.
            measured: where they are [rad].
            now: the time [s].
        """
        elapsed = now - self._told
        if command is None and (self._joints is None or 0.0 <= elapsed < _DUE * self._period):
            return None
        pan, tilt = self._joints or (_Setpoint(measured[0]), _Setpoint(measured[1]))
        for joint, position in zip((pan, tilt), measured, strict=True):
            joint.advance(elapsed if 0.0 <= elapsed <= _PAUSE else math.inf, position)
        if command is not None:
            pan.goal, pan.speed = command.pan, command.pan_speed
            tilt.goal, tilt.speed = command.tilt, command.tilt_speed
        elif pan.there and tilt.there:
            return None
        self._joints, self._told = (pan, tilt), now
        return pan.after(self._ahead), tilt.after(self._ahead)


class _Setpoint:
    def __init__(self, position: float) -> None:
        self.position = self.goal = position
        self.speed = 0.0

    @property
    def there(self) -> bool:
        return self.position == self.goal

    def advance(self, elapsed: float, measured: float) -> None:
        """Time has passed [s]; inf: nobody spoke for long, and the joint may be anywhere."""
        if elapsed == math.inf:
            if abs(self.position - measured) > _NEAR:
                self.position = measured
            return
        self.position = self.after(elapsed)
        gap = _GAP + _GAP_TIME * self.speed
        self.position = min(max(self.position, measured - gap), measured + gap)

    def after(self, time: float) -> float:
        way = self.speed * time
        return self.position + min(max(self.goal - self.position, -way), way)
