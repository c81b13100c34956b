"""What a listener hears of a tracking head, put together afterwards."""

from __future__ import annotations

import math
from bisect import bisect_left

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking.recording import Recording, Sample
from head_tracking.transforms import Vector3

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

    def recording(self, head: PanTiltHead) -> Recording:
        """The head and its target at every time the joints were measured and the target known.

        Times begin at 0.
        """
        stamps = sorted(self._points)
        samples = Recording()
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
