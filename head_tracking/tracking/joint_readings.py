"""History of the measured joint positions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SPAN = 3.0  # s
_ROOM = 2048  # readings; half of them are kept when the room is full
_VELOCITY_WINDOW = 0.06  # s
_FARTHEST = 1e4  # rad; no joint has turned so far


@dataclass(frozen=True, slots=True)
class JointReading:
    """The joints of the head at one moment.

    Attributes:
        stamp: when they were measured [s].
        positions: of pan and tilt [rad].
        velocities: of pan and tilt [rad/s].
    """

    stamp: float
    positions: tuple[float, float]
    velocities: tuple[float, float] = (0.0, 0.0)


class JointReadings:
    """Pan and tilt over the last 3 s, linear between two readings.

    Times are in seconds on the clock of the stamps.

    Attributes:
        latest: the latest reading; None before the first.
    """

    def __init__(self) -> None:
        self.latest: JointReading | None = None
        self._rows = np.empty((3, _ROOM))
        self._start = self._end = 0

    def clear(self) -> None:
        """Discard all readings."""
        self.latest = None
        self._start = self._end = 0

    def append(self, stamp: float, positions: tuple[float, float]) -> bool:
        """Accept pan and tilt [rad] measured at `stamp` [s]; return whether it was accepted.

        A reading that is not newer than the latest, or not a number, is ignored.
        """
        if not (math.isfinite(stamp) and all(abs(position) < _FARTHEST for position in positions)):
            return False
        if self.latest is not None and stamp <= self.latest.stamp:
            return False
        rows = self._rows
        if self._end == _ROOM:
            self._start = max(self._start, _ROOM // 2)
            kept = self._end - self._start
            rows[:, :kept] = rows[:, self._start :].copy()
            self._start, self._end = 0, kept
        rows[:, self._end] = stamp, *positions
        self._end += 1
        while rows[0, self._start] < stamp - _SPAN:
            self._start += 1
        self.latest = JointReading(stamp, positions, self._velocities(stamp, positions))
        return True

    def ranges(self, span: float) -> Array:
        """Return how far pan and tilt moved in the last `span` [s]: highest less lowest, (2,)."""
        since = self._rows[0, self._end - 1] - span
        first = int(np.searchsorted(self._rows[0, self._start : self._end], since))
        rows = self._rows[1:, self._start + first : self._end]
        return np.asarray(rows.max(axis=1) - rows.min(axis=1))

    def at(self, time: float) -> tuple[float, float]:
        """Return pan and tilt [rad] at a time [s]; the end values outside."""
        stamps = self._rows[0, self._start : self._end]
        after = self._start + min(max(int(stamps.searchsorted(time)), 1), len(stamps) - 1)
        columns = self._rows[:, max(after - 1, self._start) : after + 1].T.tolist()
        (before, pan, tilt), (then, next_pan, next_tilt) = columns[0], columns[-1]
        ratio = min(max((time - before) / (then - before), 0.0), 1.0) if then > before else 0.0
        return pan + ratio * (next_pan - pan), tilt + ratio * (next_tilt - tilt)

    def at_all(self, times: Array) -> tuple[Array, Array]:
        """Return pan and tilt [rad] at times [s], shape (N,) each; the end values outside."""
        stamps, pans, tilts = self._rows[:, self._start : self._end]
        return np.interp(times, stamps, pans), np.interp(times, stamps, tilts)

    def _velocities(self, stamp: float, positions: tuple[float, float]) -> tuple[float, float]:
        """Return the mean velocities [rad/s] over the last 60 ms, 0 if nothing is known of them."""
        rows, first = self._rows, self._end - 1
        while first > self._start and rows[0, first] > stamp - _VELOCITY_WINDOW:
            first -= 1
        before, pan, tilt = rows[:, first].tolist()
        elapsed = stamp - before
        if not 0.0 < elapsed < 5.0 * _VELOCITY_WINDOW:
            return 0.0, 0.0
        return (positions[0] - pan) / elapsed, (positions[1] - tilt) / elapsed
