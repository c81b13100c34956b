"""A trace of a head and its target, and the figures by which it is judged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Sample(NamedTuple):
    """The head and its target at one moment.

    Attributes:
        time: [s].
        wanted: pan and tilt that look at the target [rad].
        positions: pan and tilt [rad].
        error: angle by which the head misses the target [rad].
    """

    time: float
    wanted: tuple[float, float]
    positions: tuple[float, float]
    error: float


class Trace:
    """Samples of a run, in the order of their times.

    Args:
        samples: to begin with.
    """

    def __init__(self, samples: Sequence[Sample] = ()) -> None:
        self._samples = list(samples)

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: Sample) -> None:
        """Append a sample."""
        self._samples.append(sample)

    def between(self, start: float, end: float = math.inf) -> Trace:
        """Return the samples of a part of the time [s]."""
        return Trace([sample for sample in self._samples if start <= sample.time <= end])

    @property
    def times(self) -> Array:
        """Shape (n,) [s]."""
        return np.array([sample.time for sample in self._samples])

    @property
    def wanted(self) -> Array:
        """Pan and tilt that look at the target, shape (n, 2) [rad]."""
        return np.array([sample.wanted for sample in self._samples]).reshape(-1, 2)

    @property
    def positions(self) -> Array:
        """Pan and tilt of the head, shape (n, 2) [rad]."""
        return np.array([sample.positions for sample in self._samples]).reshape(-1, 2)

    @property
    def errors(self) -> Array:
        """By how much the head misses the target, shape (n,) [rad]."""
        return np.array([sample.error for sample in self._samples])

    @property
    def rms(self) -> float:
        """Root mean square of the error [rad]."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def maximum(self) -> float:
        """Largest error [rad]."""
        return float(self.errors.max())

    def within(self, error: float) -> float:
        """Return the ratio of the time in which the error is smaller [rad]."""
        return float((self.errors < error).mean())

    def velocities(self, positions: Array) -> Array:
        """Return the velocities of pan and tilt, shape (n, 2) [rad/s]."""
        return np.asarray(np.gradient(positions, self.times, axis=0))

    def jerk(self) -> float:
        """Return the mean absolute jerk of pan, from positions 0.02 s apart [rad/s^3]."""
        step = 0.02
        times = np.arange(self.times[0], self.times[-1], step)
        pan = np.interp(times, self.times, self.positions[:, 0])
        return float(np.abs(np.diff(pan, 3)).mean() / step**3)
