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
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_HISTORY = 1.0  # s of commands
_FIRST_DELAY = 0.04  # s, until the servo has shown its own
_UNSURE = 0.02  # s, standard deviation of the first delay

_DELAYS: Array = np.arange(0.0, 0.2501, 0.01)
"""The delays [s] that are compared."""

_WINDOW = 0.1  # s between the two readings that are compared to learn the delay
_LEARNED_EVERY = 5  # readings
_MEMORY = 3.0  # s of motion
_MODEL_ERROR = 0.004  # rad in such a window
_TELLING = 0.01  # rad; a shorter way, or ways that differ by less, tell no delays apart
_FOLLOWED = 0.35  # of the way; a shaft that misses all expected ways by more is held or pushed
_AS_GOOD = 1.5  # times the least squared error: a shorter delay that is as good is believed

_STUCK_TIME = 0.35  # s; longer than the longest delay
_STUCK_WAY = 0.1  # rad; a shaft that was told to go farther in that time, and stands, is stuck

_SPAN = 0.08  # s; over which speeds are compared to learn the acceleration
_BEHIND = 0.5  # rad/s; a shaft so much slower than told, twice in a row, gives what it can
_EXPLAINED = 0.3  # rad/s; a delay with which the shaft is no farther behind explains its speeds
_GAINED = 0.2  # rad/s in a span; less may be noise
_STEADY = 0.6  # of the gain before; less is a shaft that comes to its top speed
_SLOWEST_START = 1.0  # rad/s^2
_RECOVERY = 20.0  # s in which a limit that is not met any more grows to e times itself
_SHARE = 0.3  # of a new measurement
_HARDEST = 100.0  # rad/s^2; harder than this is no limit

_USUAL_RESOLUTION = 0.005  # rad, an AX-12's, until the encoder has shown its own
_FINEST_RESOLUTION = 1e-4  # rad

# How much of a innovation is believed: an encoder within half a step of the expectation has said
# almost nothing, beyond it the shaft is certainly somewhere else.
_WITHIN_STEP = 0.05
_BEYOND_STEP = 0.5


class ServoModel:
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
        acceleration: the hardest that it has shown, where it was told more [rad/s^2].
        velocity: of the shaft, from its readings [rad/s].
        learning: whether the delay is learned from the motion.
        stuck: whether the shaft stands still although it was told to move: no torque, or a block.
    """

    def __init__(
        self, stamp: float, position: float, speed: float = 0.0, delay: float | None = None
    ) -> None:
        self.delay = _FIRST_DELAY if delay is None else delay
        self.acceleration = math.inf
        self.velocity = speed
        self.learning = True
        self.resolution = _USUAL_RESOLUTION
        self._finest_step = math.inf
        self._first_delay = self.delay
        self._squares = self._expected_squares()
        self._unread = 0
        self._start(stamp, position, speed)
        self._readings: deque[tuple[float, float]] = deque([(stamp, position)])
        self._stood = stamp, position, position
        self.stuck = False

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

    def restart(self, now: float) -> None:
        """The servo's setpoint is where the shaft was read, as when its torque comes on."""
        reading = self.reading
        self._start(now, reading[1], 0.0)
        self._readings = deque([reading])

    def _start(self, time: float, position: float, speed: float) -> None:
        self._times, self._setpoints = [time], [position]
        self._speeds, self._rooms = [speed], [math.inf]
        self._offset = 0.0
        self._shaft = position

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
        innovation = position - self._shaft - self._offset
        within = max(-0.5 * self.resolution, min(0.5 * self.resolution, innovation))
        self._offset += _WITHIN_STEP * within + _BEYOND_STEP * (innovation - within)
        self._readings.append((stamp, position))
        self._see_whether_stuck(stamp, position)
        while self._readings[1][0] <= stamp - 3.0 * _SPAN:
            self._readings.popleft()
        follows = self._learn_acceleration(stamp - last_stamp)
        self._unread += 1
        if self.learning and follows and self._unread >= _LEARNED_EVERY:
            self._unread = 0
            self._learn_delay()

    def _see_whether_stuck(self, stamp: float, position: float) -> None:
        since, stood, told = self._stood
        setpoint = self._sum(stamp - self.delay)
        if abs(position - stood) > 2.0 * self.resolution:
            self._stood, self.stuck = (stamp, position, setpoint), False
        elif stamp - since > _STUCK_TIME and abs(setpoint - told) > _STUCK_WAY:
            self.stuck = True

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
        """Compares how far the shaft moved in a window with what every delay makes expected."""
        end, last = self._readings[-1]
        start, first = self._reading_before(end - _WINDOW)
        times, setpoints = self._knots()
        expected = np.interp(end - _DELAYS, times, setpoints)
        expected -= np.interp(start - _DELAYS, times, setpoints)
        misses = expected - (last - first)
        if abs(last - first) < _TELLING or np.ptp(expected) < _TELLING:
            return
        nearest = float(np.abs(misses).min())
        if nearest > _FOLLOWED * max(abs(last - first), float(np.abs(expected).max())):
            return  # held, pushed, or at its limit
        elapsed = _LEARNED_EVERY * (end - self._readings[-2][0])
        self._squares = math.exp(-elapsed / _MEMORY) * self._squares + misses * misses
        self.delay = _least(self._squares)

    def _expected_squares(self) -> Array:
        """What is expected of every delay before the servo has moved."""
        return np.asarray((_MODEL_ERROR * (_DELAYS - self.delay) / _UNSURE) ** 2)

    def _reading_before(self, time: float) -> tuple[float, float]:
        """The newest reading that is not after a time [s]; else the oldest."""
        for reading in reversed(self._readings):
            if reading[0] <= time:
                return reading
        return self._readings[0]

    def _learn_acceleration(self, elapsed: float) -> bool:
        """How hard the shaft accelerates while it is slower, or faster, than it was told to be.

        Whether it follows what it is told; else its motion tells no delay.
        """
        if self.acceleration < math.inf:
            self.acceleration *= math.exp(elapsed / _RECOVERY)
            if self.acceleration > _HARDEST:
                self.acceleration = math.inf
        end, last = self._readings[-1]
        stamp, position = self._reading_before(end - _SPAN)
        if stamp == end:
            return True
        self.velocity = (last - position) / (end - stamp)
        asked_now = (self._sum(end - self.delay) - self._sum(stamp - self.delay)) / (end - stamp)
        if abs(asked_now - self.velocity) < _BEHIND:
            return True
        stamps, positions = zip(
            *(self._reading_before(end - spans * _SPAN) for spans in (3, 2, 1, 0)), strict=True
        )
        if len(set(stamps)) < 4:
            return True
        told = _speeds(stamps, [self._sum(stamp - self.delay) for stamp in stamps])
        shown = _speeds(stamps, positions)
        behind = [told[span] - shown[span] for span in range(3)]
        if min(behind) < _BEHIND and max(behind) > -_BEHIND:
            return True
        if self._late(stamps, shown):
            return True
        gained, before, asked = shown[2] - shown[1], shown[1] - shown[0], told[2] - told[1]
        if gained * asked > 0.0 and abs(gained) > _STEADY * abs(asked) > _STEADY * _GAINED:
            return True  # it comes after
        if gained * behind[2] > 0.0 and abs(gained) > max(_GAINED, _STEADY * abs(before)):
            self._limited(max(2.0 * abs(gained) / (end - stamps[1]), _SLOWEST_START))
        return False

    def _late(self, stamps: Sequence[float], shown: Sequence[float]) -> bool:
        """Whether a longer delay explains all speeds of the shaft."""
        times, setpoints = self._knots()
        ways = np.interp(np.array(stamps)[:, None] - _DELAYS, times, setpoints)
        told = np.diff(ways, axis=0) / np.diff(stamps)[:, None]
        return bool(np.abs(told - np.array(shown)[:, None]).max(axis=0).min() < _EXPLAINED)

    def _limited(self, acceleration: float) -> None:
        """The shaft has accelerated no harder although it was told to."""
        if acceleration >= self.acceleration:
            return
        if self.acceleration == math.inf:
            self.acceleration = acceleration
            # what it could not follow before tells no delay
            self.delay = min(self.delay, self._first_delay)
            self._squares = self._expected_squares()
        self.acceleration += _SHARE * (acceleration - self.acceleration)

    def _knots(self) -> tuple[Array, Array]:
        """The setpoint as a polyline: times [s] and positions [rad]."""
        times, setpoints = [], []
        ends = (*self._times[1:], math.inf)
        for time, end, setpoint, speed, room in zip(
            self._times, ends, self._setpoints, self._speeds, self._rooms, strict=True
        ):
            times.append(time)
            setpoints.append(setpoint)
            if speed and time + room / abs(speed) < end:
                times.append(time + room / abs(speed))
                setpoints.append(setpoint + math.copysign(room, speed))
        return np.array(times), np.array(setpoints)


def _least(squares: Array) -> float:
    """The delay [s] of the least squared error, between the ones that were compared."""
    least = int(squares.argmin())
    inner = squares[1:-1]
    minima = np.flatnonzero((inner <= squares[:-2]) & (inner < squares[2:])) + 1
    for index in minima[minima < least]:
        if squares[index] < _AS_GOOD * squares[least]:
            least = int(index)
            break
    if not 0 < least < len(squares) - 1:
        return float(_DELAYS[least])
    before, here, after = squares[least - 1 : least + 2]
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(_DELAYS[least] + shift * (_DELAYS[1] - _DELAYS[0]))


def _speeds(stamps: Sequence[float], positions: Sequence[float]) -> list[float]:
    """Between positions [rad], one after the other [rad/s]."""
    return [
        (position - before) / (stamp - earlier)
        for (earlier, stamp), (before, position) in zip(
            pairwise(stamps), pairwise(positions), strict=True
        )
    ]
