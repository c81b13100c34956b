"""Turning the head to one point, which may move, until the measured joints have arrived."""

from __future__ import annotations

from collections import deque

from head_tracking.gaze import Gaze, PanTiltHead, PointingResult
from head_tracking.transforms import Vector3

_RAMP = 0.2  # s in which a turn comes to its speed, and to rest
_ARRIVED = 0.1  # s for which the head must have been on its target
_WELL = 0.3  # of the threshold: nothing is gained by waiting until the head is nearer
_STEADY = 0.006  # rad; a head that nears or leaves its target by less in that time is on it
_STILL = 0.006  # rad; a joint that moved less did not move: a little over a tick of an AX-12
_WINDOW = 0.15  # s over which the target's motion is measured
_AHEAD = 0.3  # s for which it is taken to go on


class Turn:
    """The way of pan and tilt to a point, and how it ends. Times are in seconds, on any clock.

    Both joints set out and arrive together, the one with the longer way at `max_velocity` or as
    much slower as `min_duration` asks. A point that moves is met, and followed until the head has
    arrived.

    Args:
        head: what is pointed.
        max_velocity: of either joint [rad/s].
        min_duration: the turn takes so long at least [s].
        threshold: the head has arrived when it misses by less [rad].
        settle_time: what the head misses by after it has stood still for so long [s] counts, if
            it has not been well on its target before.

    Attributes:
        head: as given.
        max_velocity: as given.
        miss: of the measured head [rad]; None before it was aimed.
    """

    def __init__(
        self,
        head: PanTiltHead,
        max_velocity: float,
        min_duration: float,
        threshold: float,
        settle_time: float,
    ) -> None:
        self.head = head
        self.max_velocity = max_velocity
        self.miss: float | None = None
        self._min_duration = min_duration
        self._threshold = threshold
        self._settle_time = settle_time
        self._start = (0.0, 0.0)
        self._began = self._duration = 0.0
        self._gazes: deque[tuple[float, tuple[float, float]]] = deque()
        self._rate = (0.0, 0.0)
        self._seen = 0.0
        self._errors: deque[tuple[float, tuple[float, float]]] = deque()
        self._rest = (0.0, 0.0)
        self._still_since = self._beside_since = 0.0

    def aim(
        self,
        point: Vector3,
        stamp: float | None,
        start: tuple[float, float],
        present: tuple[float, float],
        now: float,
    ) -> Gaze:
        """Takes the point as it is now; the gaze at it, or the one that comes nearest to it.

        Args:
            point: shape (3,) [m], in the head's base frame.
            stamp: when it was there [s]; None: it does not move.
            start: where the joints are meant to be at the beginning [rad].
            present: where they were measured [rad].
            now: the time [s].
        """
        gaze = self.head.gaze(point, *(self._gazes[-1][1] if self._gazes else present))
        positions = gaze.pan, gaze.tilt
        if self.miss is None:
            self._start, self._began = start, now
            longest = max(abs(there - here) for here, there in zip(start, positions, strict=True))
            self._duration = max(self._min_duration, longest / self.max_velocity + _RAMP)
            self._rest, self._still_since = present, now
        self.miss = self.head.miss(point, *present)
        if stamp is None or not self._gazes or stamp > self._gazes[-1][0]:
            self._seen = now if stamp is None else stamp
            self._gazes.append((self._seen, positions))
            while len(self._gazes) > 2 and self._gazes[0][0] < self._seen - _WINDOW:
                self._gazes.popleft()
            before, old = self._gazes[0]
            if stamp is not None and before < self._seen:
                pan, tilt = (
                    (b - a) / (self._seen - before) for a, b in zip(old, positions, strict=True)
                )
                self._rate = pan, tilt
        if self.miss > self._threshold:
            self._beside_since = now
        error = present[0] - positions[0], present[1] - positions[1]
        self._errors.append((now, error))
        while len(self._errors) > 2 and self._errors[1][0] <= now - _ARRIVED:
            self._errors.popleft()
        if any(abs(a - b) > _STILL for a, b in zip(present, self._rest, strict=True)):
            self._rest, self._still_since = present, now
        return gaze

    def positions(self, time: float) -> tuple[float, float]:
        """Where pan and tilt are meant to be at a time [s]."""
        share = self._share(time - self._began)
        ahead = min(max(time - self._seen, 0.0), _AHEAD)
        pan, tilt = (
            here + share * (there + ahead * rate - here)
            for here, there, rate in zip(self._start, self._gazes[-1][1], self._rate, strict=True)
        )
        return self.head.pan_limits.clamp(pan), self.head.tilt_limits.clamp(tilt)

    def judge(self, now: float) -> PointingResult | None:
        """How the turn ended; None as long as it is under way."""
        if self.miss is None or now < self._began + self._duration:
            return None
        since, first = self._errors[0]
        steady = now - since >= _ARRIVED and all(
            abs(a - b) <= _STEADY for a, b in zip(first, self._errors[-1][1], strict=True)
        )
        if self.miss <= _WELL * self._threshold and steady:
            return PointingResult(True, self.miss)
        followed = max(map(abs, self._rate)) > _STEADY
        if now - (self._beside_since if followed else self._still_since) < self._settle_time:
            return None
        arrived = self.miss <= self._threshold
        return None if followed and not arrived else PointingResult(arrived, self.miss)

    def _share(self, elapsed: float) -> float:
        """Of the way that is done: even speed, reached and left within a ramp."""
        whole = self._duration
        ramp = min(_RAMP, 0.5 * whole)
        if ramp <= 0.0 or elapsed >= whole:
            return 1.0
        left = whole - elapsed
        if elapsed <= 0.0:
            return 0.0
        speed = 1.0 / (whole - ramp)
        if elapsed < ramp:
            return 0.5 * speed * elapsed * elapsed / ramp
        if left < ramp:
            return 1.0 - 0.5 * speed * left * left / ramp
        return speed * (elapsed - 0.5 * ramp)
