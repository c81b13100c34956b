"""By how much the stamps of a camera that moves with the head are wrong.

A point of such a camera is placed with the joints as they were at its stamp. If the stamp is wrong,
the head's own motion is mistaken for the target's, and a head that follows it oscillates. The
points tell: placed as if each stamp error in turn were the true one, they make the smoothest path
for the error that is.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import Sight

Array = npt.NDArray[np.float64]

_ERRORS: Array = np.arange(-0.15, 0.1501, 0.01)
"""The stamp errors [s] that are compared."""

_WINDOW = 0.6  # s; over which a path is compared with a parabola
_FEWEST, _MOST = 9, 24  # points in it
_EVERY = 3  # points
_MEMORY = 2.0  # s
_HISTORY = 2.0  # s of readings and points
_DEGREES = (2, 4)  # of the polynomials that paths are compared with
_ROUGHER = (2.5, 1.4)  # times the smoothest path: so rough is the present one to be given up
_TELLING = 0.004  # rad; rougher than noise
_AGAINST = 1.5  # times rougher by the other polynomial: then it is not believed
_SAME = 0.004  # s; errors that differ by less


class StampError:
    """Learns the error while the head moves.

    Times are in seconds on the clock of the stamps.

    Attributes:
        value: the error that is believed [s]: stamps are so much too late.
    """

    def __init__(self) -> None:
        self.value = 0.0
        self._times: deque[float] = deque()
        self._readings: deque[tuple[float, float]] = deque()
        self._points: deque[tuple[float, Sight]] = deque()
        self._roughness = np.zeros((len(_DEGREES), len(_ERRORS)))
        self._weight = 0.0
        self._judged = -math.inf

    def reset(self) -> None:
        """Everything starts anew."""
        self.__init__()  # type: ignore[misc]

    def new_target(self) -> None:
        """The points that come from now on are another target's."""
        self._points.clear()

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """Takes pan and tilt [rad] as measured at `stamp` [s]; stamps rise."""
        self._times.append(stamp)
        self._readings.append(positions)
        while self._times[0] < stamp - _HISTORY:
            self._times.popleft()
            self._readings.popleft()

    def corrected(self, stamp: float, sight: Sight) -> Sight:
        """The sight of a point placed with the joints at `stamp`, as it is by the learned error."""
        then, now = self._at(stamp), self._at(stamp - self.value)
        return Sight(sight.pan + now[0] - then[0], sight.tilt + now[1] - then[1], sight.distance)

    def point_seen(self, stamp: float, sight: Sight, *, moving: bool) -> bool:
        """Takes a point as placed by its stamp [s]; whether another error is believed now.

        Args:
            stamp: of the point [s].
            sight: as it was placed.
            moving: whether the camera moves with the head; else no stamp error moves the point.
        """
        if self._points and stamp <= self._points[-1][0]:
            return False
        self._points.append((stamp, sight))
        while self._points[0][0] < stamp - _HISTORY:
            self._points.popleft()
        newest = self._times[-1] + float(_ERRORS[0]) if self._times else -math.inf
        known = [point for point in self._points if point[0] <= newest]
        fresh = sum(1 for point in known if point[0] > self._judged)
        if fresh < _EVERY or len(known) < _FEWEST:
            return False
        start = min(known[-1][0] - _WINDOW, known[-_FEWEST][0])
        window = [point for point in known if point[0] >= start][-_MOST:]
        if window[0][0] + float(_ERRORS[0]) < self._times[0]:
            return False
        elapsed = known[-1][0] - max(self._judged, known[0][0])
        self._judged = known[-1][0]
        self._judge(window, math.exp(-elapsed / _MEMORY), moving)
        return moving and self._decide()

    def _judge(self, window: list[tuple[float, Sight]], kept: float, moving: bool) -> None:
        """How rough the path is for every error: what polynomials leave of it."""
        stamps = np.array([stamp for stamp, _ in window])
        times = np.array(self._times)
        placed = stamps[:, None] - _ERRORS
        centred = (stamps - stamps.mean()) / (stamps[-1] - stamps[0])
        basis = np.linalg.qr(np.vander(centred, max(_DEGREES) + 1, increasing=True))[0]
        rough = np.zeros(self._roughness.shape)
        for joint in (0, 1):
            angles = np.array([reading[joint] for reading in self._readings])
            seen = np.array([sight[joint] for _, sight in window])
            head = np.interp(stamps, times, angles)
            paths = np.repeat(seen[:, None], len(_ERRORS), axis=1)
            if moving:
                paths += np.interp(placed, times, angles) - head[:, None]
            shares = np.cumsum((basis.T @ paths) ** 2, axis=0)
            rough += (paths * paths).sum(axis=0) - shares[list(_DEGREES)]
        self._roughness = kept * self._roughness + rough
        self._weight = kept * self._weight + len(window)

    def _decide(self) -> bool:
        """Whether another error makes a path so much smoother that it is believed now."""
        coarse, fine = self._roughness
        for rough, other, rougher in ((coarse, fine, _ROUGHER[0]), (fine, coarse, _ROUGHER[1])):
            present = float(np.interp(self.value, _ERRORS, rough))
            least = int(rough.argmin())
            if present < rougher * rough[least]:
                continue
            if present - rough[least] < self._weight * _TELLING**2:
                continue
            if other[least] > _AGAINST * float(np.interp(self.value, _ERRORS, other)):
                continue
            error = _minimum(rough, least)
            if abs(error - self.value) < _SAME:
                return False
            self.value = error
            return True
        return False

    def _at(self, time: float) -> tuple[float, float]:
        """Pan and tilt [rad] at a time, between the readings or as the nearest one says."""
        times = self._times
        index = bisect_left(times, time)
        if index == 0:
            return self._readings[0]
        if index == len(times):
            return self._readings[-1]
        share = (time - times[index - 1]) / (times[index] - times[index - 1])
        before, after = self._readings[index - 1], self._readings[index]
        return (
            before[0] + share * (after[0] - before[0]),
            before[1] + share * (after[1] - before[1]),
        )


def _minimum(rough: Array, least: int) -> float:
    """The stamp error [s] of the smoothest path, between the ones that were compared."""
    shift = 0.0
    if 0 < least < len(rough) - 1:
        before, here, after = rough[least - 1 : least + 2]
        bend = before - 2.0 * here + after
        shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(_ERRORS[least] + shift * (_ERRORS[1] - _ERRORS[0]))
