"""The limit: what an AX-12 can do for somebody who knows the target's future and the servo."""

from __future__ import annotations

import math
from collections import deque

from closed_loop import Path

from head_tracking.gaze import HeadCommand, PanTiltHead
from head_tracking.tracking import TrackingStep
from head_tracking.transforms import Vector3

BUS_DELAY = 0.0013  # s from a command until the servo has it, in the trial's timing
LAG = 0.027  # s, of the servo: slope and damping of its compliance
MARGIN = 0.0051  # rad, of its compliance
TICK = 0.00511  # rad
STEP = 0.005  # s of the servo's model
FASTEST, ACCELERATION = 6.0, 60.0  # rad/s, rad/s^2


class PerfectCommand:
    """Steers by a model of the simulated servo and by the true path of the target."""

    def __init__(self, head: PanTiltHead, path: Path, start: float, period: float) -> None:
        self._head, self._path, self._start, self._period = head, path, start, period
        self._joints = (_PerfectJoint(period), _PerfectJoint(period))
        self._positions: tuple[float, float] | None = None

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """See `Controller`."""
        self._positions = positions
        for joint, position in zip(self._joints, positions, strict=True):
            joint.measured(stamp, position)

    def target_seen(
        self, stamp: float, point: Vector3, now: float, *, moving: bool = False
    ) -> None:
        """It needs none."""

    def step(self, now: float) -> TrackingStep:
        """See `Controller`."""
        if self._positions is None:
            return TrackingStep()
        end = now + BUS_DELAY + self._period
        before, at, after = (self._gaze(end + dt) for dt in (-0.002, 0.0, 0.002))
        goals, speeds = [], []
        for index, joint in enumerate(self._joints):
            velocity = (after[index] - before[index]) / 0.004
            speed = joint.command(now, at[index], velocity)
            ahead = math.copysign(min(0.5, 0.06 + 0.25 * abs(speed)), speed)
            limits = (self._head.pan_limits, self._head.tilt_limits)[index]
            goals.append(limits.clamp(self._positions[index] + ahead))
            speeds.append(max(abs(speed), 1e-3))
        return TrackingStep(HeadCommand(goals[0], goals[1], speeds[0], speeds[1]))

    def _gaze(self, time: float) -> tuple[float, float]:
        assert self._positions is not None
        gaze = self._head.gaze(self._path(time - self._start), *self._positions)
        return gaze.pan, gaze.tilt


class _PerfectJoint:
    """A first order servo whose setpoint moves at the commanded speed, inverted."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._commands: deque[tuple[float, float]] = deque(maxlen=30)
        self._state: tuple[float, float, float] | None = None  # time, shaft, setpoint
        self._side = 0.0

    def measured(self, stamp: float, position: float) -> None:
        if self._state is None:
            self._state = (stamp, position, position)
            return
        shaft, setpoint = self._at(stamp)
        error = position - shaft
        within = max(-0.5 * TICK, min(0.5 * TICK, error))
        correction = 0.05 * within + 0.5 * (error - within)
        self._state = (stamp, shaft + correction, setpoint + correction)

    def command(self, now: float, position: float, velocity: float) -> float:
        """The speed for now, for a position and a velocity at the end of its time."""
        shaft, setpoint = self._at(now + BUS_DELAY)
        if abs(velocity) > 0.02:
            self._side = math.copysign(1.0, velocity)
        speed = (position + self._side * MARGIN + LAG * velocity - setpoint) / self._period
        needed = (position - shaft) / self._period
        if (setpoint - shaft) * needed > 0.0 and abs(setpoint - shaft) > MARGIN:
            # the servo never turns faster than it is told: so fast it must be told at least
            speed = max(speed, needed) if needed > 0.0 else min(speed, needed)
        last = self._commands[-1][1] if self._commands else 0.0
        change = ACCELERATION * self._period
        speed = max(last - change, min(last + change, speed))
        speed = max(-FASTEST, min(FASTEST, speed))
        self._commands.append((now, speed))
        return speed

    def _at(self, time: float) -> tuple[float, float]:
        assert self._state is not None
        now, shaft, setpoint = self._state
        while now < time - 1e-9:
            dt = min(STEP, time - now)
            speed = self._speed(now - BUS_DELAY)
            setpoint += speed * dt
            gap = setpoint - shaft
            way = max(0.0, abs(gap) - MARGIN) * -math.expm1(-dt / LAG)
            shaft += math.copysign(min(way, abs(speed) * dt), gap)
            now += dt
        return shaft, setpoint

    def _speed(self, time: float) -> float:
        for at, speed in reversed(self._commands):
            if at <= time:
                return speed
        return 0.0
