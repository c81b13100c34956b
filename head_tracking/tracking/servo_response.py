"""How a servo follows the speeds that it is told, learned while it does.

A servo that is given a goal far ahead moves a setpoint towards it at the moving speed, and its
shaft comes after: later by a delay (the bus cycle, the servo's start and its lag), and short of it
by a dead band in which the servo does not drive. Both are ours to learn: the commanded speeds,
summed up, are the setpoint, and the encoder tells the rest.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque

_HISTORY = 1.0  # s of commands
_FIRST_DELAY = 0.04  # s, until the servo has shown its own
_LONGEST_DELAY = 0.15  # s
_UNSURE = 0.02  # s, standard deviation of the first delay
_DRIFT = 1e-3  # s per square root of a second: what a delay may change
_WINDOW = 0.1  # s between the two readings that are compared to learn the delay
_SLOWEST = 0.1  # rad/s; slower motion tells little of the delay
_MODEL_ERROR = 0.004  # rad in such a window
_LAG_ERROR = 0.03  # s: what one window can tell of the delay at best

_USUAL_RESOLUTION = 0.005  # rad, an AX-12's, until the encoder has shown its own
_FINEST_RESOLUTION = 1e-4  # rad

# How much of a surprise is believed: an encoder within half a step of the expectation has said
# almost nothing, beyond it the shaft is certainly somewhere else.
_WITHIN_STEP = 0.05
_BEYOND_STEP = 0.5


class ServoResponse:
    """One joint: expects where its shaft is and learns from where it was.

    Times are in seconds on any clock, positions in rad, speeds in rad/s with sign.

    Args:
        stamp: time of the first reading.
        position: that reading.
        speed: the speed commanded at that time.
        delay: the delay to start with [s]; None: a usual one.

    Attributes:
        delay: from a command to the motion it causes [s].
        resolution: one step of the encoder [rad].
        learning: whether the delay is learned from the motion.
    """

    def __init__(
        self, stamp: float, position: float, speed: float = 0.0, delay: float | None = None
    ) -> None:
        self.delay = _FIRST_DELAY if delay is None else delay
        self.learning = True
        self.resolution = _USUAL_RESOLUTION
        self._finest_step = math.inf
        self._variance = _UNSURE**2
        self._times = [stamp]
        self._setpoints = [position]
        self._speeds = [speed]
        self._rooms = [math.inf]
        self._offset = 0.0
        self._shaft = position
        self._readings: deque[tuple[float, float]] = deque([(stamp, position)])

    @property
    def dead_band(self) -> float:
        """How far the shaft stays behind the setpoint at lowest speed [rad].

        An AX-12 does not drive within one step of its encoder; a finer one holds finer.
        """
        return self.resolution

    @property
    def speed(self) -> float:
        """The newest commanded speed."""
        return self._speeds[-1]

    @property
    def reading(self) -> tuple[float, float]:
        """Stamp and position of the newest reading."""
        return self._readings[-1]

    def setpoint(self, time: float) -> float:
        """Where the servo's setpoint was or will be if no other command comes."""
        return self._sum(time) + self._offset

    def commanded(self, now: float, speed: float, goal: float) -> None:
        """The servo is told to move on at this speed from now on, and to stay at this goal."""
        setpoint = self._sum(now)
        room = max(0.0, (goal - self._offset - setpoint) * math.copysign(1.0, speed))
        self._append(now, setpoint, speed, room)

    def held(self, now: float, setpoint: float) -> None:
        """The servo is told to go to this position and stay."""
        self._append(now, setpoint - self._offset, 0.0, 0.0)

    def expected(self, time: float) -> float:
        """Where the shaft is at a time not before the newest reading."""
        return self._follow(self._shaft, self._sum(time - self.delay)) + self._offset

    def measured(self, stamp: float, position: float) -> None:
        """Takes a reading of the encoder; one that is not newer than the last is ignored."""
        last_stamp, last = self._readings[-1]
        if stamp <= last_stamp:
            return
        self._learn_resolution(abs(position - last))
        self._shaft = self._follow(self._shaft, self._sum(stamp - self.delay))
        surprise = position - self._shaft - self._offset
        within = max(-0.5 * self.resolution, min(0.5 * self.resolution, surprise))
        self._offset += _WITHIN_STEP * within + _BEYOND_STEP * (surprise - within)
        self._readings.append((stamp, position))
        while self._readings[1][0] <= stamp - _WINDOW:
            self._readings.popleft()
        if self.learning:
            self._learn_delay()

    def _follow(self, shaft: float, setpoint: float) -> float:
        """The shaft is dragged along by the edges of the dead band."""
        return min(max(shaft, setpoint - self.dead_band), setpoint + self.dead_band)

    def _sum(self, time: float) -> float:
        times = self._times
        index = -1 if time >= times[-1] else bisect_right(times, time) - 1
        if time <= times[0]:
            return self._setpoints[0]
        way, room = self._speeds[index] * (time - times[index]), self._rooms[index]
        if not -room <= way <= room:
            way = math.copysign(room, way)
        return self._setpoints[index] + way

    def _speed_at(self, time: float) -> float:
        return self._speeds[max(0, bisect_right(self._times, time) - 1)]

    def _append(self, now: float, setpoint: float, speed: float, room: float) -> None:
        self._times.append(now)
        self._setpoints.append(setpoint)
        self._speeds.append(speed)
        self._rooms.append(room)
        if len(self._times) > 2 and self._times[1] < now - _HISTORY:
            del self._times[0], self._setpoints[0], self._speeds[0], self._rooms[0]

    def _learn_resolution(self, step: float) -> None:
        if _FINEST_RESOLUTION < step < self._finest_step:
            self._finest_step = self.resolution = step

    def _learn_delay(self) -> None:
        """One step of a Kalman filter for the delay, from how far the shaft moved in a window."""
        (start, first), (end, last) = self._readings[0], self._readings[-1]
        before, after = self._speed_at(start - self.delay), self._speed_at(end - self.delay)
        if min(abs(before), abs(after)) < _SLOWEST or before * after < 0.0:
            return
        expected = self._sum(end - self.delay) - self._sum(start - self.delay)
        moved = last - first
        if not 0.5 < moved / expected < 2.0 if expected else True:
            return  # held, pushed, or at its limit
        slope = before - after  # what the expected way loses per second of delay
        noise = self.resolution**2 / 6.0 + _MODEL_ERROR**2 + (_LAG_ERROR * slope) ** 2
        self._variance += _DRIFT**2 * (end - self._readings[-2][0])
        if (moved - expected) ** 2 > 9.0 * (slope * slope * self._variance + noise):
            return
        gain = self._variance * slope / (slope * slope * self._variance + noise)
        self._variance *= 1.0 - gain * slope
        delay = self.delay + gain * (moved - expected)
        self.delay = min(max(delay, 0.0), _LONGEST_DELAY)
