"""Model of a servo: set-point, delay, dead band and acceleration of its shaft.

A servo that gets a goal far ahead moves a set-point towards it at the commanded speed. Its shaft
follows: later by a delay (the bus cycle, the servo's start and its lag), dragged along by the
edges of a dead band in which the servo does not drive, with an acceleration that is limited. The
set-point is the sum of the commands. Delay, dead band and limit are one posterior over a grid of
hypotheses; docs/explain/estimator.md has the equations.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from head_tracking.tracking.learned import (
    KNOWN,
    LearnedValue,
    Learning,
    LearningParameters,
    ServoValues,
)

Array = npt.NDArray[np.float64]

_CELL = 0.01  # s
_CELLS = 36  # delays of 0 to 350 ms
_WINDOW = 10  # cells over which displacements are compared
_KEPT = _CELLS + _WINDOW + 1
_ROOM = 1024  # cells of the buffer
_DELAYS: Array = np.array([_CELL * cell for cell in range(_CELLS)])
_BANDS: Array = np.array([0.0, 0.002, 0.004, 0.007, 0.012])  # rad, to either side
_LIMITS: Array = np.array([3.0, 5.0, 8.0, 13.0, 21.0, 34.0, 100.0])  # rad/s^2; the last: none
_RARE_BAND = 200.0  # 1/rad: less likely by e^-(this times the band)
_RARE_LIMIT = 1.7  # less likely by e^-this than no limit
_SHAPE = len(_BANDS), len(_LIMITS), _CELLS  # of the posterior
_STRIDE = 2  # cells in a step of a shaft with a limit
_PATHS = np.arange(_CELLS)[::-1, None] + np.arange(0, _WINDOW + 1, _STRIDE)
_ACTIVE = 0.03  # rad; a limit is compared if displacements differ by more
_CATCH_UP = 0.03  # s; time constant with which a shaft reduces its error
_AWAY = 0.03  # rad; larger distances from the set-point are no offset
_UNEXPLAINED = 0.2  # of that distance counts as an error
_FAR = 0.15  # rad; limit of that distance
_STEP = 0.03  # s; the speed of a shaft is measured over two of these
_ASTRAY = 0.07  # rad; least distance of a shaft that does not follow
_WEAK = 13.0  # rad/s^2; a shaft that accelerates less overshoots its set-point when it comes back
_VAGUE = 0.06  # s; deviation of a delay that may be longer instead
_LOGS: Array = np.log(np.maximum(_DELAYS, 0.5 * _CELL) / 0.045).astype(float)
_RARITY: Array = np.add.outer(_RARE_BAND * _BANDS, [*(_RARE_LIMIT for _ in _LIMITS[:-1]), 0.0])
_PRIOR: Array = -_LOGS - 0.5 * (_LOGS / 0.8) ** 2 - _RARITY[..., None]
"""Logarithm of the prior: log-normal in the delay, with a median of 45 ms; wide bands and limits
are rare."""

_BAND_DEVIATION = 0.0029  # rad: of the prior of the dead band
_INFORMED = 0.9  # of that; a dead band with a larger deviation is not observable
_ROUGH = 0.5  # of its value; an acceleration with a larger deviation is not observable

_LEAST_DEVIATION = 0.015  # s; the lag depends on the motion
_EVERY = 0.06  # s between two windows
_NOISE = 0.004  # rad of a displacement: the step of an AX-12's encoder
_MODEL_ERROR = 0.04  # of a displacement
_DISTINCT = 0.012  # rad; hypotheses that differ by less in a window are not compared
_MEMORY = 6.0  # s of motion
_GAIN = 0.08  # standard deviation of the servo's scale
_SHARPNESS = 0.25  # factor on the scores: windows overlap, and errors are correlated

_SAVED_DELAY = 0.02  # s; least deviation of a saved delay
_SAVED_BAND = 0.003  # rad; deviation of a saved dead band
_TRUST = 5.0  # largest log likelihood of saved values
_CONTRADICTED = 0.8  # of that; saved values with a larger mean loss are dropped

_NARROW = 0.9  # of the posterior in three cells
_SLEW = 0.1  # s/s; a new mean is applied so fast

_READING = 0.002  # rad: deviation of a reading
_SCALE = 0.03  # of the way: deviation of the set-point's own scale
_DRIFT = 0.01  # rad/sqrt(s): of the set-point
_FIRST = 0.005  # rad: deviation of a set-point that was restarted
_OUTLIER = 3.0  # deviations; larger differences are limited to this
_FASTEST = 0.1  # s in which an offset is corrected at the fastest


def _statistics(weights: Array, values: npt.ArrayLike) -> tuple[float, float]:
    """Return mean and standard deviation of values by their weights, of any sum."""
    total = weights.sum()
    mean = float(weights @ np.asarray(values) / total)
    square = float(weights @ (np.asarray(values) - mean) ** 2 / total)
    return mean, math.sqrt(square)


class ShaftModel:
    """Estimate one joint's set-point, and the delay, dead band and acceleration of its shaft.

    Times are in seconds on any clock, positions in rad, speeds in rad/s with sign.

    Attributes:
        parameters: whether the posterior changes; values that are used instead of it.
        delay: from a command to the motion it causes, as used [s]; it follows `mean` slowly.
        mean: of the delay's posterior [s].
        deviation: standard deviation of the delay's posterior [s].
        learned: time of its last change [s]; -inf: never.
        saved: values of an earlier run; None: none, or they were contradicted.
        is_contradicted: whether `saved` was given and did not fit; the reader resets it.
    """

    def __init__(self) -> None:
        self.parameters = LearningParameters()
        self.forget()
        self.restart(0.0, 0.0)

    def forget(self) -> None:
        """Discard the estimates; call `restart` next."""
        self._xx: Array = np.zeros(_SHAPE)
        self._xy: Array = np.zeros_like(self._xx)
        self._yy: Array = np.zeros_like(self._xx)
        self._windows, self.learned = 0.0, -math.inf
        self.expect(None)

    @property
    def _is_learning(self) -> bool:
        return self.parameters.servo_learning != Learning.FREEZE

    @property
    def values(self) -> Mapping[str, LearnedValue]:
        """The estimates, by name."""
        saved, frozen = self.saved if self.learned == -math.inf else None, not self._is_learning
        at, is_saved = (self.learned, False) if saved is None else (saved.saved, True)
        delay = LearnedValue(
            self.parameters.servo_delay or self.delay,
            "s",
            self.deviation,
            at,
            KNOWN,
            is_given=self.parameters.servo_delay > 0.0,
            is_saved=is_saved,
            is_frozen=frozen,
        )
        band = LearnedValue(
            self.dead_band,
            "rad",
            self._band[1],
            at,
            _INFORMED * _BAND_DEVIATION,
            is_given=self.parameters.servo_dead_band > 0.0,
            is_saved=saved is not None and saved.dead_band is not None,
            is_frozen=frozen,
        )
        acceleration = LearnedValue(
            self.acceleration,
            "rad/s^2",
            self._acceleration[1],
            self.learned,
            _ROUGH * self.acceleration,
            is_given=self.parameters.servo_acceleration > 0.0,
            is_frozen=frozen,
        )
        return {"delay of its servo": delay, "dead band": band, "acceleration": acceleration}

    @property
    def dead_band(self) -> float:
        """How far the shaft stays behind the set-point [rad]."""
        return self.parameters.servo_dead_band or self._band[0]

    @property
    def acceleration(self) -> float:
        """How hard the shaft can accelerate [rad/s^2]: geometric mean of the posterior."""
        return self.parameters.servo_acceleration or self._acceleration[0]

    @property
    def to_save(self) -> ServoValues | None:
        """The estimates to save; None: the deviation of the delay is too large."""
        if self.learned == -math.inf or self.deviation > KNOWN:
            return None
        band = self.values["dead band"]
        observed = self._band[0] if band.deviation < band.known else None
        return ServoValues(self.mean, self.deviation, observed)

    def expect(self, saved: ServoValues | None) -> None:
        """Start with values of an earlier run; they count until motion contradicts them."""
        self.saved, self.is_contradicted = saved, False
        self._expected: Array = np.zeros_like(self._xx)
        if saved is not None:
            spread = max(saved.deviation, _SAVED_DELAY)
            off = ((_DELAYS - saved.delay) / spread) ** 2
            if saved.dead_band is not None:
                off = off + (((_BANDS - saved.dead_band) / _SAVED_BAND) ** 2)[:, None, None]
            self._expected += np.maximum(-0.5 * off, -_TRUST)
        self._posterior()
        self.delay = self.parameters.servo_delay or self.mean

    @property
    def reading(self) -> tuple[float, float]:
        """Stamp and position of the latest reading."""
        return self._readings[-1]

    def setpoint(self, time: float) -> float:
        """Return where the set-point is at a time since the last command, if no other comes."""
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
        """Start from a reading, as after a pause; the estimates are kept.

        Args:
            stamp: of the reading [s].
            position: that reading [rad].
            speed: the speed commanded at that time [rad/s].
        """
        self._command = stamp, position, speed, math.inf
        self.delay = self.parameters.servo_delay or self.delay
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
        goal = self.parameters.servo_delay or self.mean
        change = _SLEW * (stamp - last)
        self.delay += min(max(goal - self.delay, -change), change)

    def astray(self, now: float) -> tuple[float, float] | None:
        """Return where a shaft that has not followed will be when a command of now acts.

        The cause, and what it does with earlier commands, are unknown: its measured speed is
        extrapolated.

        Returns:
            position [rad] and speed [rad/s]; None: the shaft has followed its commands.
        """
        stamp, position = self.reading
        gap = position - self._shaft(stamp - self.delay, 0) - self._offset
        before = self._at(stamp - 2.0 * _STEP)
        if abs(gap) < _ASTRAY or before is None:
            return None
        speed = (position - before) / (2.0 * _STEP)
        if speed * gap > 0.0:
            return None  # away it brakes as hard as it can
        if self.acceleration > _WEAK or self.deviation > _VAGUE:
            likely = self._grid[0, self._filled - _CELLS : self._filled] + self._offset
            if likely.min() - _AWAY < position < likely.max() + _AWAY:
                return None  # some delay explains it
        return position + speed * (now + self.delay - stamp), speed

    def _correct(self, elapsed: float, stamp: float, position: float) -> None:
        """Update the set-point's offset by a Kalman filter; errors due to the delay are noise."""
        deviation = 0.0 if self.parameters.servo_delay else self.deviation
        here = self._shaft(stamp - self.delay, self._best)
        before = self._shaft(stamp - self.delay - max(deviation, elapsed), self._best)
        spread = abs(here - before) if deviation else 0.0
        moved = (here - before) * elapsed / max(deviation, elapsed)
        self._variance += _DRIFT**2 * elapsed + (_SCALE * moved) ** 2
        off = position - here - self._offset
        expected = self._variance + _READING**2 + spread**2
        most = _OUTLIER * math.sqrt(expected)
        gain = min(self._variance / expected, elapsed / _FASTEST)
        self._offset += gain * min(max(off, -most), most) / (1.0 + (off / _ASTRAY) ** 2)
        self._variance *= 1.0 - gain

    def _shaft(self, time: float, band: int) -> float:
        """Return where a shaft with a dead band would be at a time [s] without a delay."""
        place = min(max((time - self._grid_start) / _CELL, 0.0), self._filled - 1.0)
        cell = min(int(place), self._filled - 2)
        before, after = self._grid[band, cell : cell + 2].tolist()
        return float(before + (place - cell) * (after - before))

    def _sum(self, time: float) -> float:
        """Return the sum of the commands at a time since the last one [s]."""
        start, setpoint, speed, room = self._command
        way = speed * max(time - start, 0.0)
        return setpoint + min(max(way, -room), room)

    def _append(self, now: float, setpoint: float, speed: float, room: float) -> None:
        self._fill(now)
        self._judge()
        self._command = now, setpoint, speed, room

    def _fill(self, now: float) -> None:
        """Continue the path of the shaft for each dead band up to a time [s]."""
        grid, shafts = self._grid, self._shafts
        while (time := self._grid_start + self._filled * _CELL) <= now:
            if self._filled == _ROOM:
                grid[:, :_KEPT] = grid[:, _ROOM - _KEPT :]
                self._grid_start += (_ROOM - _KEPT) * _CELL
                self._filled = _KEPT
            setpoint = self._sum(time)
            for row, band in enumerate(_BANDS.tolist()):
                shafts[row] = min(max(shafts[row], setpoint - band), setpoint + band)
            grid[:, self._filled] = shafts
            self._filled += 1

    def _judge(self) -> None:
        """Compare the displacement in a window with that of every hypothesis."""
        cell = min(int((self.reading[0] - self._grid_start) / _CELL), self._filled - 1)
        latest = self._grid_start + cell * _CELL
        first = cell + 1 - _CELLS - _WINDOW
        if first < 0 or latest < self._judged + _EVERY or not self._is_learning:
            return  # the first cells after the buffer was shifted have no window before them
        position = self._at(latest)
        before = self._at(latest - _WINDOW * _CELL)
        if position is None or before is None:
            return
        elapsed, self._judged = latest - self._judged, latest
        recent = self._grid[:, first : cell + 1]
        followed = (recent[:, _WINDOW:] - recent[:, :-_WINDOW])[:, ::-1]
        spread = float(np.ptp(followed))
        if spread < _DISTINCT:
            return
        moved = position - before
        share = min(elapsed / (_WINDOW * _CELL), 1.0)
        weight = share / (_NOISE**2 + (_MODEL_ERROR * moved) ** 2)
        kept = math.exp(-elapsed / _MEMORY)
        expected = np.repeat(followed[:, None], len(_LIMITS), axis=1)
        self._yy = kept * self._yy + weight * moved * moved
        if spread > _ACTIVE:
            slower, unexplained = self._limited(recent[0], before, latest)
            expected[:, :-1] += slower
            self._yy[:, :-1] += weight * unexplained * unexplained
        self._xx = kept * self._xx + weight * expected * expected
        self._xy = kept * self._xy + (weight * moved) * expected
        self._windows = kept * self._windows + share
        self.learned = latest
        self._posterior()

    def _limited(self, setpoints: Array, start: float, stamp: float) -> tuple[Array, Array]:
        """Predict the window for shafts of limited acceleration from where the shaft began.

        Args:
            setpoints: of the latest cells [rad].
            start: where the shaft was at the start of the window [rad].
            stamp: the end of the window [s].

        Returns:
            by how much a limit changes the displacement, for each limit and delay [rad], and the
            part of the distance between shaft and set-point at the start that a limit must
            explain, for each delay [rad].
        """
        begin = stamp - _WINDOW * _CELL
        before, after = self._at(begin - _STEP), self._at(begin + _STEP)
        path, step = setpoints[_PATHS].T, _STRIDE * _CELL
        away = start - self._offset - path[0]
        away -= np.clip(away, -_AWAY, _AWAY)
        most = (_LIMITS[:-1] * step)[:, None]
        shaft = np.tile(path[0] + away, (len(most), 1))
        velocity = 0.0 if before is None or after is None else (after - before) / (2.0 * _STEP)
        speed = np.full_like(shaft, velocity)
        for here, there in pairwise(path):
            wanted = (there - here) / step + (here - shaft) / _CATCH_UP
            change = np.clip(wanted - speed, -most, most)
            shaft += (speed + 0.5 * change) * step
            speed += change
        return shaft - path[-1] - away, _UNEXPLAINED * np.clip(away, -_FAR, _FAR)

    def _at(self, time: float) -> float | None:
        """Return the interpolated position at a time [s]; None: no reading was near."""
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
        """Compute means and deviations; the scale of the servo is profiled out."""
        tight = 1.0 / _GAIN**2
        squares = self._yy + tight - (self._xy + tight) ** 2 / (self._xx + tight)
        score = _PRIOR - 0.5 * _SHARPNESS * (self._windows + 4.0) * np.log(4.0 + squares)
        score += self._expected
        weights = np.exp(score - score.max())
        weights /= weights.sum()
        if self.saved is not None and np.vdot(weights, self._expected) < -_CONTRADICTED * _TRUST:
            # the next window is judged without it
            self.saved, self.is_contradicted = None, True
            self._expected = np.zeros_like(self._xx)
        by_delay = weights.sum(axis=(0, 1))
        self.mean, deviation = _statistics(by_delay, _DELAYS)
        self.deviation = max(deviation, _LEAST_DEVIATION)
        by_band, by_limit = weights.sum(axis=(1, 2)), weights.sum(axis=(0, 2))
        self._best = int(by_band.argmax())
        self._band = _statistics(by_band, _BANDS)
        limit, spread = _statistics(by_limit, np.log(_LIMITS))
        is_limited = by_limit[-1] < 0.5
        self._acceleration = math.exp(limit), spread * math.exp(limit) if is_limited else math.inf
        best = int(by_delay.argmax())
        if 0 < best < _CELLS - 1 and float(by_delay[best - 1 : best + 2].sum()) > _NARROW:
            # narrower than the grid: the vertex of the parabola through three scores
            before, here, after = score[self._best, by_limit.argmax(), best - 1 : best + 2].tolist()
            bend = before - 2.0 * here + after
            if bend < 0.0:
                self.mean = _CELL * (best + 0.5 * (before - after) / bend)
