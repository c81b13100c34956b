"""Converts goals with speeds into a stream of positions, for a joint_trajectory_controller.

A command moves a simulated set-point at its speed, as a servo moves its own. The stream is the
position of that set-point a moment later; it ends when the set-point has reached its goal.
"""

from __future__ import annotations

import math

from head_tracking.gaze import AT_GOAL, HeadCommand
from head_tracking.tracking.following import FollowingWatch
from head_tracking.tracking.joint_readings import JointReading

_PAUSE = 0.2  # s without a command, after which a set-point restarts at the measured position
_PATIENCE = 0.6  # s of measurements without motion, after which a joint counts as not following
_LEAD = 0.03  # s: the delay with which a servo follows positions
_DUE = 0.9  # of a period


class SetpointStream:
    """The set-points of pan and tilt. Times are in seconds, on any clock.

    A set-point is ahead of its joint by the delay of the controller. If a joint does not follow
    (`FollowingWatch`), its set-point returns to the measured position.

    Args:
        period: time between two positions of the stream [s].
        ahead: time that the controller has to reach a position [s].
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
        self, command: HeadCommand | None, joints: JointReading, now: float
    ) -> tuple[float, float] | None:
        """Return the positions of pan and tilt to send [rad]; None: there is nothing to send now.

        Args:
            command: a new command; None: continue the last one.
            joints: the latest measurement.
            now: the time [s].
        """
        elapsed = now - self._sent
        if command is None and (self._joints is None or 0.0 <= elapsed < _DUE * self._period):
            return None
        here = joints.positions
        pan, tilt = self._joints or (_Setpoint(here[0]), _Setpoint(here[1]))
        for joint, position in zip((pan, tilt), here, strict=True):
            if 0.0 <= elapsed <= _PAUSE:
                joint.advance(elapsed, position, joints.stamp)
            else:
                joint.restart(position)
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
        self._watch = FollowingWatch(_PATIENCE)

    @property
    def at_goal(self) -> bool:
        return self.position == self.goal

    def restart(self, measured: float) -> None:
        self._watch.restart()
        if abs(self.position - measured) > AT_GOAL:
            self.position = measured

    def advance(self, elapsed: float, measured: float, stamp: float) -> None:
        self.position = self.after(elapsed)
        if self._watch.check(self.goal, self.speed, measured, stamp):
            self.position = measured

    def after(self, time: float) -> float:
        way = self.speed * time
        return self.position + min(max(self.goal - self.position, -way), way)
