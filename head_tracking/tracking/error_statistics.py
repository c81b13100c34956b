"""How well a target is followed: every moment is judged by where the target was then."""

from __future__ import annotations

import math
from collections import deque

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking.trace import Sample, Trace
from head_tracking.transforms import Vector3

_LONGEST_WAIT = 1.0  # s; a moment waits so long for the next point


class ErrorStatistics:
    """Root mean square and maximum of an angle [rad]."""

    def __init__(self) -> None:
        self.count = 0
        self.maximum = 0.0
        self._squares = 0.0

    def add(self, error: float) -> None:
        """Add one error [rad]."""
        self.count += 1
        self.maximum = max(self.maximum, abs(error))
        self._squares += error * error

    @property
    def rms(self) -> float:
        """The root mean square [rad]; 0 without any error."""
        return math.sqrt(self._squares / self.count) if self.count else 0.0


class TrackingJudge:
    """Compute by how much a head misses its target, at every moment its joints were measured.

    Points arrive late: a moment waits until the points before and after it are there, and the
    target is interpolated between them. If no point arrives for 1 s, the latest one holds until the
    target is lost. Times are in seconds.

    Args:
        head: the head that is judged.
        settling: errors count from so long [s] after the first point; inf: they do not.
        trace: receives every moment, its times from 0; None: only the statistics are kept.
        statistics: receives the errors that count, beside those of earlier heads; None: new ones.

    Attributes:
        head: as given; so are `statistics` and `settling`, which may be changed.
        error: the latest one [rad]; None before the first, and after the target was lost.
    """

    def __init__(
        self,
        head: PanTiltHead,
        settling: float,
        trace: Trace | None = None,
        statistics: ErrorStatistics | None = None,
    ) -> None:
        self.statistics = statistics or ErrorStatistics()
        self.error: float | None = None
        self.head = head
        self.settling = settling
        self._trace = trace
        self._first: float | None = None
        self._before: tuple[float, Vector3] | None = None
        self._latest: tuple[float, Vector3] | None = None
        self._moments: deque[tuple[float, tuple[float, float]]] = deque()

    def joints_read(self, now: float, positions: tuple[float, float]) -> None:
        """Accept pan and tilt [rad] at a time [s]."""
        if self._moments and now < self._moments[-1][0]:
            self._restart()  # the clock has jumped
        self._moments.append((now, positions))
        while self._moments[0][0] < now - _LONGEST_WAIT:
            time, at = self._moments.popleft()
            if self._latest is not None:
                self._judge(time, at, self._latest[1])

    def target_seen(self, stamp: float, point: Vector3) -> None:
        """Accept a point, shape (3,) [m], in the head's base frame, that was there at `stamp`."""
        if self._latest is not None and stamp <= self._latest[0]:
            if stamp > self._latest[0] - _LONGEST_WAIT:
                return
            self._restart()  # the clock has jumped
        if self._first is None:
            self._first = stamp
        self._before, self._latest = self._latest, (stamp, point)
        while self._moments and self._moments[0][0] <= stamp:
            time, positions = self._moments.popleft()
            self._judge(time, positions, self._between(time))

    def target_lost(self, now: float) -> None:
        """Judge no moment until the next point, if none has come for 1 s before `now`."""
        if self._latest is not None and now > self._latest[0] + _LONGEST_WAIT:
            self._forget()

    def _forget(self) -> None:
        self._moments.clear()
        self._latest = self._before = self.error = None

    def _restart(self) -> None:
        self._forget()
        self._first = None

    def _between(self, time: float) -> Vector3:
        """Return where the target was at a time before the latest point."""
        assert self._latest is not None
        after, (u, v, w) = self._latest
        if self._before is None or time <= self._before[0]:
            return u, v, w
        before, (x, y, z) = self._before
        ratio = (time - before) / (after - before)
        return x + ratio * (u - x), y + ratio * (v - y), z + ratio * (w - z)

    def _judge(self, time: float, positions: tuple[float, float], point: Vector3) -> None:
        assert self._first is not None
        if time < self._first:
            return
        self.error = self.head.miss(point, *positions)
        if time - self._first >= self.settling:
            self.statistics.add(self.error)
        if self._trace is not None:
            gaze = self.head.gaze(point, *positions)
            sample = Sample(time - self._first, (gaze.pan, gaze.tilt), positions, self.error)
            self._trace.add(sample)
