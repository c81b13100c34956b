"""How a servo follows its commands: set-point, delay and dead band, estimated from the encoder.

A servo that gets a goal far ahead moves a set-point towards it at the commanded speed. Its shaft
follows: later by a delay (the bus cycle, the servo's start and its lag), and dragged along by the
edges of a dead band in which the servo does not drive. The set-point is the sum of the commands.
Delay and dead band are a posterior over a grid of hypotheses; docs/guide/tracking.md describes it.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_HISTORY = 1.0  # s of commands

_CELL = 0.01  # s
_CELLS = 36  # delays of 0 to 350 ms
_WINDOW = 10  # cells over which displacements are compared
_KEPT = _CELLS + _WINDOW + 1
_ROOM = 1024  # cells of the buffer
_DELAYS: Array = np.array([_CELL * cell for cell in range(_CELLS)])
_BANDS: Array = np.array([0.0, 0.002, 0.004, 0.007, 0.012])  # rad, to either side
_BAND_LIST: list[float] = _BANDS.tolist()
_LOGS: Array = np.log(np.maximum(_DELAYS, 0.5 * _CELL) / 0.045).astype(float)
_PRIOR: Array = -_LOGS - 0.5 * (_LOGS / 0.7) ** 2 - 200.0 * _BANDS[:, None]
"""Logarithm of the prior: log-normal in the delay, with a median of 45 ms; wide bands are rare."""

_UNSURE = 0.03  # s
_LEAST_DEVIATION = 0.015  # s: lags differ from motion to motion
_EVERY = 0.06  # s between two windows
_NOISE = 0.004  # rad of a displacement: the step of an AX-12's encoder
_MODEL_ERROR = 0.04  # of a displacement
_TELLING = 0.012  # rad; hypotheses that differ by less in a window are not compared
_MEMORY = 6.0  # s of motion
_GAIN = 0.08  # standard deviation of the servo's scale
_SHARPNESS = 0.15  # windows overlap, and errors last

_BEHIND = 0.05  # rad in a window; a shaft so far from what likely delays explain tells no delay
_BEYOND = 0.05  # rad in a window; a shaft so much faster than it was commanded swings
_SLEWING = 25  # cells in which a servo with a profile comes from one speed to another
_SLOWEST_START = 2.0  # rad/s^2
_RECOVERY = 30.0  # s in which a limit that is not met any more grows to e times itself

_NARROW = 0.9  # of the posterior in three cells
_SLEW = 0.1  # s/s; a new mean is applied so fast

_READING = 0.002  # rad: deviation of a reading
_SCALE = 0.03  # of the way: deviation of the set-point's own scale
_DRIFT = 0.01  # rad/sqrt(s): of the set-point
_FIRST = 0.005  # rad: deviation of a set-point that was restarted
_OUTLIER = 3.0  # deviations; so much of a reading that is farther off is believed
_FASTEST = 0.1  # s in which an offset is corrected at the fastest


class ServoModel:
    """Estimate one joint's set-point, delay and dead band.

    Times are in seconds on any clock, positions in rad, speeds in rad/s with sign.

    Attributes:
        known_delay: a delay that is used instead of the posterior [s]; 0: none.
        delay: from a command to the motion it causes, as it is used [s]: it follows the mean of
            the posterior without jumps.
        mean: of the delay's posterior [s].
        deviation: standard deviation of the delay's posterior [s].
        dead_band: mean of the posterior: how far the shaft stays behind the set-point [rad].
        shown: the hardest acceleration that the shaft has shown in its latest motion [rad/s^2].
        acceleration: the hardest that the shaft has shown [rad/s^2], if it was seen to swing
            beyond its commands; else inf.
    """

    def __init__(self) -> None:
        self._xx: Array = np.zeros((len(_BANDS), _CELLS))
        self._xy: Array = np.zeros_like(self._xx)
        self._yy = self._windows = 0.0
        self._posterior()
        self.delay = self.mean
        self.known_delay = 0.0
        self.acceleration, self.shown = math.inf, 0.0
        self.restart(0.0, 0.0)

    @property
    def known(self) -> bool:
        """Whether the delay is known well enough to move fast."""
        return self.known_delay > 0.0 or self.deviation < _UNSURE

    @property
    def speed(self) -> float:
        """The latest commanded speed."""
        return self._speeds[-1]

    @property
    def reading(self) -> tuple[float, float]:
        """Stamp and position of the latest reading."""
        return self._readings[-1]

    def setpoint(self, time: float) -> float:
        """Return where the set-point was, or will be if no other command comes."""
        return self._sum(time) + self._offset

    def command(self, now: float, speed: float, goal: float) -> None:
        """Record a command: move at this speed [rad/s] from now on, and stay at the goal [rad]."""
        start = self._sum(now)
        room = max(0.0, (goal - self._offset - start) * math.copysign(1.0, speed))
        self._append(now, start, speed, room)

    def hold(self, now: float, setpoint: float) -> None:
        """Record a command: go to this position [rad] and stay."""
        self._append(now, setpoint - self._offset, 0.0, 0.0)

    def restart(self, stamp: float, position: float, speed: float = 0.0) -> None:
        """Start from a reading, as after a pause; what was learned of the servo is kept.

        Args:
            stamp: of the reading [s].
            position: that reading [rad].
            speed: the speed commanded at that time [rad/s].
        """
        self._times, self._setpoints = [stamp], [position]
        self._speeds, self._rooms = [speed], [math.inf]
        self.delay = self.known_delay or self.delay
        self._miss = 0.0
        self._offset, self._variance = 0.0, _FIRST**2
        self._readings: deque[tuple[float, float]] = deque([(stamp, position)])
        self._shafts = [position] * len(_BANDS)
        self._grid: Array = np.empty((len(_BANDS), _ROOM))
        self._grid[:, :_KEPT] = position
        self._filled = _KEPT
        self._grid_start = stamp - (_KEPT - 1) * _CELL
        self._judged = stamp + _CELLS * _CELL  # what was commanded before is not known

    def measured(self, stamp: float, position: float) -> None:
        """Receive a reading of the encoder; one that is not newer than the last is ignored."""
        last, _ = self._readings[-1]
        if stamp <= last:
            return
        self._readings.append((stamp, position))
        self._fill(stamp)
        while self._readings[1][0] <= stamp - (2 * _WINDOW + 8) * _CELL:
            self._readings.popleft()
        self._correct(stamp - last, stamp, position)
        goal = self.known_delay or self.mean
        change = _SLEW * (stamp - last)
        self.delay += min(max(goal - self.delay, -change), change)

    def _correct(self, elapsed: float, stamp: float, position: float) -> None:
        """A Kalman filter of the set-point's offset: what the delay may explain is not believed."""
        deviation = 0.0 if self.known_delay else self.deviation
        here = self._shaft(stamp - self.delay)
        before = self._shaft(stamp - self.delay - max(deviation, elapsed))
        spread = abs(here - before) if deviation else 0.0
        moved = (here - before) * elapsed / max(deviation, elapsed)
        self._variance += _DRIFT**2 * elapsed + (_SCALE * moved) ** 2
        off = position - here - self._offset
        expected = self._variance + _READING**2 + spread**2 + (2.0 * self._miss) ** 2
        most = _OUTLIER * math.sqrt(expected)
        gain = min(self._variance / expected, elapsed / _FASTEST)
        self._offset += gain * min(max(off, -most), most)
        self._variance *= 1.0 - gain

    def _shaft(self, time: float) -> float:
        """Where the shaft of the best hypothesis would be at a time [s] if it had no delay."""
        place = min(max((time - self._grid_start) / _CELL, 0.0), self._filled - 1.0)
        cell = min(int(place), self._filled - 2)
        before, after = self._grid[self._best, cell : cell + 2].tolist()
        return float(before + (place - cell) * (after - before))

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
        self._fill(now)
        self._judge()
        self._times.append(now)
        self._setpoints.append(setpoint)
        self._speeds.append(speed)
        self._rooms.append(room)
        if len(self._times) > 2 and self._times[1] < now - _HISTORY:
            del self._times[0], self._setpoints[0], self._speeds[0], self._rooms[0]

    def _fill(self, now: float) -> None:
        """Continue the shaft's path for every dead band, cell by cell, up to a time [s]."""
        grid = self._grid
        while (time := self._grid_start + self._filled * _CELL) <= now:
            if self._filled == _ROOM:
                grid[:, :_KEPT] = grid[:, _ROOM - _KEPT :]
                self._grid_start += (_ROOM - _KEPT) * _CELL
                self._filled = _KEPT
            self._move_shafts(self._sum(time))
            grid[:, self._filled] = self._shafts
            self._filled += 1

    def _move_shafts(self, setpoint: float) -> None:
        """Move the shaft of every hypothesis for a cell, after which the set-point is there."""
        shafts = self._shafts
        for row, band in enumerate(_BAND_LIST):
            if shafts[row] < setpoint - band:
                shafts[row] = setpoint - band
            elif shafts[row] > setpoint + band:
                shafts[row] = setpoint + band

    def _judge(self) -> None:
        """Compare the shaft's displacement in a window with the one of every hypothesis."""
        cell = min(int((self.reading[0] - self._grid_start) / _CELL), self._filled - 1)
        newest = self._grid_start + cell * _CELL
        if newest < self._judged + _EVERY:
            return
        position = self._at(newest)
        before = self._at(newest - _WINDOW * _CELL)
        if position is None or before is None:
            return
        elapsed, self._judged = newest - self._judged, newest
        recent = self._grid[:, cell + 1 - _CELLS - _WINDOW : cell + 1]
        expected = (recent[:, _WINDOW:] - recent[:, :-_WINDOW])[:, ::-1]
        moved = position - before
        self._learn_acceleration(moved, before, newest, elapsed, expected)
        if self._miss > _BEHIND or float(np.ptp(expected)) < _TELLING:
            return
        share = min(elapsed / (_WINDOW * _CELL), 1.0)
        weight = share / (_NOISE**2 + (_MODEL_ERROR * moved) ** 2)
        kept = math.exp(-elapsed / _MEMORY)
        self._xx = kept * self._xx + weight * expected * expected
        self._xy = kept * self._xy + (weight * moved) * expected
        self._yy = kept * self._yy + weight * moved * moved
        self._windows = kept * self._windows + share
        self._posterior()

    def _learn_acceleration(
        self, moved: float, before: float, stamp: float, elapsed: float, expected: Array
    ) -> None:
        """A shaft that swings faster than it was commanded accelerates as hard as it can."""
        window = _WINDOW * _CELL
        start = self._at(stamp - 2.0 * window)
        first = max(round((self.delay - 2.0 * self.deviation) / _CELL) - 1, 0)
        last = round((self.delay + 2.0 * self.deviation) / _CELL) + 2
        likely = expected[self._best, first:last]
        self._miss = float(np.abs(likely - moved).min())
        self.acceleration *= math.exp(elapsed / _RECOVERY)
        if abs(moved) > _TELLING:
            self.shown *= math.exp(-elapsed / _RECOVERY)
        if start is not None:
            self.shown = max(self.shown, abs(moved - (before - start)) / window**2)
        likely = expected[self._best, first : last + _SLEWING]
        swings = max(moved - float(likely.max()), float(likely.min()) - moved) > _BEYOND
        if swings and self.shown > _SLOWEST_START:
            self.acceleration = self.shown

    def _at(self, time: float) -> float | None:
        """The reading at a time [s], between two; None: there was none near."""
        later = None
        for stamp, position in reversed(self._readings):
            if stamp <= time:
                if later is None or later[0] - stamp > 0.1:
                    return None
                ratio = (time - stamp) / (later[0] - stamp)
                return position + ratio * (later[1] - position)
            later = stamp, position
        return None

    def _posterior(self) -> None:
        """Mean and deviation of delay and dead band; the servo's scale is profiled out."""
        tight = 1.0 / _GAIN**2
        squares = self._yy + tight - (self._xy + tight) ** 2 / (self._xx + tight)
        score = _PRIOR - 0.5 * _SHARPNESS * (self._windows + 4.0) * np.log(4.0 + squares)
        weights = np.exp(score - score.max())
        weights /= weights.sum()
        by_delay = weights.sum(axis=0)
        self.mean = float(by_delay @ _DELAYS)
        variance = float(by_delay @ (_DELAYS - self.mean) ** 2)
        self.deviation = max(math.sqrt(variance), _LEAST_DEVIATION)
        by_shaft = weights.sum(axis=1)
        self._best = int(by_shaft.argmax())
        self.dead_band = float(by_shaft @ _BANDS)
        best = int(by_delay.argmax())
        if 0 < best < _CELLS - 1 and float(by_delay[best - 1 : best + 2].sum()) > _NARROW:
            # narrower than the grid: the vertex of the parabola through three scores
            before, here, after = score[self._best, best - 1 : best + 2].tolist()
            bend = before - 2.0 * here + after
            if bend < 0.0:
                self.mean = _CELL * (best + 0.5 * (before - after) / bend)
