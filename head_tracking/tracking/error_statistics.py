"""How well a target was followed."""

from __future__ import annotations

import math
from collections import deque

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import Vector3

_LONGEST_WAIT = 1.0  # s; a moment waits so long for the next point


class ErrorStatistics:
    """Root mean square and maximum of an angle [rad]."""

    def __init__(self) -> None:
        self.count = 0
        self.maximum = 0.0
        self._squares = 0.0

    def add(self, error: float) -> None:
        """Takes one error [rad]."""
        self.count += 1
        self.maximum = max(self.maximum, abs(error))
        self._squares += error * error

    @property
    def rms(self) -> float:
        """The root mean square [rad]; 0 without any error taken."""
        return math.sqrt(self._squares / self.count) if self.count else 0.0


class TrackingJudge:
    """By how much a head misses its target, every moment judged by where the target was then.

    Points are known late, and now and then: a moment waits until the points before and after it are
    there; where none comes any more, the newest one holds. Times are in seconds.

    Args:
        head: the head that is judged.
        settling: the head may take so long [s] to find its first target before errors count.

    Attributes:
        head: the head that is judged.
        statistics: of all errors that count.
        error: the newest one [rad]; None before the first.
    """

    def __init__(self, head: PanTiltHead, settling: float) -> None:
        self.statistics = ErrorStatistics()
        self.error: float | None = None
        self.head = head
        self._settling = settling
        self._first: float | None = None
        self._before: tuple[float, Vector3] | None = None
        self._newest: tuple[float, Vector3] | None = None
        self._moments: deque[tuple[float, tuple[float, float]]] = deque()

    def joints_stand(self, now: float, positions: tuple[float, float]) -> None:
        """Takes pan and tilt [rad] as they are now."""
        if self._moments and now < self._moments[-1][0]:
            self._restart()  # the clock has jumped
        self._moments.append((now, positions))
        while self._moments[0][0] < now - _LONGEST_WAIT:
            time, at = self._moments.popleft()
            if self._newest is not None:
                self._judge(time, at, self._newest[1])

    def target_seen(self, stamp: float, point: Vector3) -> None:
        """Takes a point, shape (3,) [m], in the head's base frame, that was there at `stamp`."""
        if self._newest is not None and stamp <= self._newest[0]:
            if stamp > self._newest[0] - _LONGEST_WAIT:
                return
            self._restart()  # the clock has jumped
        if self._first is None:
            self._first = stamp
        self._before, self._newest = self._newest, (stamp, point)
        while self._moments and self._moments[0][0] <= stamp:
            time, positions = self._moments.popleft()
            self._judge(time, positions, self._between(time))

    def _restart(self) -> None:
        self._moments.clear()
        self._newest = self._before = self._first = None

    def _between(self, time: float) -> Vector3:
        """Where the target was at a time before the newest point."""
        assert self._newest is not None
        after, (u, v, w) = self._newest
        if self._before is None or time <= self._before[0]:
            return u, v, w
        before, (x, y, z) = self._before
        share = (time - before) / (after - before)
        return x + share * (u - x), y + share * (v - y), z + share * (w - z)

    def _judge(self, time: float, positions: tuple[float, float], point: Vector3) -> None:
        self.error = self.head.miss(point, *positions)
        assert self._first is not None
        if time - self._first >= self._settling:
            self.statistics.add(self.error)
