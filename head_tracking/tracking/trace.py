"""A trace of a head and its target, what it is made of, and the figures by which it is judged."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import Vector3

Array = npt.NDArray[np.float64]


class Sample(NamedTuple):
    """The head and its target at one moment.

    Attributes:
        time: [s].
        wanted: pan and tilt that look at the target [rad].
        positions: pan and tilt [rad].
        error: by how much the head misses the target [rad].
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
        """Takes another sample."""
        self._samples.append(sample)

    def between(self, start: float, end: float = math.inf) -> Trace:
        """The samples of a part of the time [s]."""
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
        """The share of the time, 0 to 1, in which the error is smaller [rad]."""
        return float((self.errors < error).mean())

    def settled(self, error: float) -> float:
        """The time [s] after which the error stays smaller [rad]; inf if it does not."""
        outside = np.flatnonzero(self.errors >= error)
        if not len(outside):
            return float(self.times[0])
        after = outside[-1] + 1
        return float(self.times[after]) if after < len(self) else math.inf

    def velocities(self, positions: Array) -> Array:
        """Speeds of pan and tilt, shape (n, 2) [rad/s]."""
        return np.asarray(np.gradient(positions, self.times, axis=0))

    def jerk(self) -> float:
        """Mean absolute jerk of pan, from positions 0.02 s apart [rad/s^3]."""
        step = 0.02
        times = np.arange(self.times[0], self.times[-1], step)
        pan = np.interp(times, self.times, self.positions[:, 0])
        return float(np.abs(np.diff(pan, 3)).mean() / step**3)


_LONGEST_GAP = 0.25  # s between points over which the target is interpolated


class TrackRecord:
    """Target points and joint positions, each with its stamp; they may come in any order.

    Attributes:
        ages: of the points when they came [s].
    """

    def __init__(self) -> None:
        self.ages: list[float] = []
        self._points: dict[float, Vector3] = {}
        self._joints: dict[float, tuple[float, float]] = {}

    def target_seen(self, stamp: float, point: Vector3, now: float) -> None:
        """Takes a point [m], in the head's base frame, seen at `stamp` and come `now` [s]."""
        self._points[stamp] = point
        self.ages.append(now - stamp)

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """Takes pan and tilt [rad] as measured at `stamp` [s]."""
        self._joints[stamp] = positions

    @property
    def target_rate(self) -> float:
        """Points a second; 0 with less than two."""
        stamps = sorted(self._points)
        return (len(stamps) - 1) / (stamps[-1] - stamps[0]) if len(stamps) > 1 else 0.0

    def trace(self, head: PanTiltHead) -> Trace:
        """The head and its target at every time the joints were measured and the target known.

        Times begin at 0.
        """
        stamps = sorted(self._points)
        samples = Trace()
        start: float | None = None
        for stamp in sorted(self._joints):
            point = self._point_at(stamps, stamp)
            if point is None:
                continue
            start = stamp if start is None else start
            positions = self._joints[stamp]
            gaze = head.gaze(point, *positions)
            miss = head.miss(point, *positions)
            samples.add(Sample(stamp - start, (gaze.pan, gaze.tilt), positions, miss))
        return samples

    def _point_at(self, stamps: list[float], time: float) -> Vector3 | None:
        index = bisect_left(stamps, time)
        if index < len(stamps) and stamps[index] == time:
            return self._points[time]
        if not 0 < index < len(stamps):
            return None
        before, after = stamps[index - 1], stamps[index]
        if not 0.0 < after - before <= _LONGEST_GAP or not math.isfinite(after):
            return None
        share = (time - before) / (after - before)
        (x, y, z), (u, v, w) = self._points[before], self._points[after]
        return x + share * (u - x), y + share * (v - y), z + share * (w - z)
