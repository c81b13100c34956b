"""Commands for servos as a stream of positions, for a head that another controller drives.

A command, a goal and a speed, moves a servo's set-point. Here that set-point is kept, and the
place where it will be a moment later is sent until the set-point has reached its goal.
"""

from __future__ import annotations

import math

from head_tracking.gaze import AT_GOAL, HeadCommand
from head_tracking.tracking.following import FollowingWatch

_PAUSE = 0.2  # s; after a longer one a set-point starts where the joint is
_PATIENCE = 0.6  # s; a joint that has not moved by then is not waited for
_LEAD = 0.03  # s; positions are sent so much earlier: a servo follows a position so much later
_DUE = 0.9  # of a period


class SetpointStream:
    """The set-points of pan and tilt. Times are in seconds, on any clock, and go on.

    A set-point runs ahead of its joint by as much as the controller is late. Only a joint that
    does not follow (`FollowingWatch`) takes its set-point back to where it was measured.

    Args:
        period: between two positions of the stream [s].
        ahead: how long a position has to be reached [s].
    """

    def __init__(self, period: float, ahead: float) -> None:
        self._period = period
        self._ahead = max(period, ahead) + _LEAD
        self._joints: tuple[_Setpoint, _Setpoint] | None = None
        self._sent = -math.inf

    @property
    def active(self) -> bool:
        """Whether a position was sent since `stop`."""
        return self._joints is not None

    def stop(self) -> None:
        """Send nothing more."""
        self._joints = None

    def positions(
        self, command: HeadCommand | None, measured: tuple[float, float], now: float
    ) -> tuple[float, float] | None:
        """Return the positions of pan and tilt to send [rad]; None: there is nothing to send now.

        Args:
            command: a new one; None: the last one counts.
            measured: positions of pan and tilt [rad].
            now: the time [s].
        """
        elapsed = now - self._sent
        if command is None and (self._joints is None or 0.0 <= elapsed < _DUE * self._period):
            return None
        pan, tilt = self._joints or (_Setpoint(measured[0]), _Setpoint(measured[1]))
        for joint, position in zip((pan, tilt), measured, strict=True):
            joint.advance(elapsed if 0.0 <= elapsed <= _PAUSE else math.inf, position, now)
        if command is not None:
            pan.goal, pan.speed = command.pan, command.pan_speed
            tilt.goal, tilt.speed = command.tilt, command.tilt_speed
        elif pan.at_goal and tilt.at_goal:
            return None
        self._joints, self._sent = (pan, tilt), now
        return pan.after(self._ahead), tilt.after(self._ahead)


class _Setpoint:
    def __init__(self, position: float) -> None:
        self.position = self.goal = position
        self.speed = 0.0
        self._watch = FollowingWatch("", _PATIENCE)

    @property
    def at_goal(self) -> bool:
        return self.position == self.goal

    def advance(self, elapsed: float, measured: float, now: float) -> None:
        """Let time pass [s]; inf: nothing was sent for long, and the joint may be anywhere."""
        if elapsed == math.inf:
            self._watch.restart()
            if abs(self.position - measured) > AT_GOAL:
                self.position = measured
            return
        self.position = self.after(elapsed)
        if self._watch.check(self.goal, self.speed, measured, now):
            self.position = measured

    def after(self, time: float) -> float:
        way = self.speed * time
        return self.position + min(max(self.goal - self.position, -way), way)
