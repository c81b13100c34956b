"""The motion of a head to one point, which may move, until the measured joints have arrived."""

from __future__ import annotations

from collections import deque

from head_tracking.gaze import Arrival, Gaze, PanTiltHead, PointingResult
from head_tracking.tracking.trajectory import JointPoint
from head_tracking.transforms import Vector3

_RAMP = 0.2  # s of acceleration, and of braking
_ON_TARGET = 0.1  # s with a small, steady miss after which the turn ends
_SMALL_MISS = 0.3  # of the threshold
_STEADY = 0.006  # rad; a miss that changes less within `_ON_TARGET` is steady
_STILL = 0.006  # rad; a joint that moved less stands still: a little over one tick of an AX-12
_WINDOW = 0.15  # s over which the target's velocity is measured
_LEAD_TIME = 0.3  # s for which that velocity is extrapolated at most


class Turn:
    """The motion of pan and tilt to a point, and its result. Times are in seconds, on any clock.

    Both joints start and arrive together; the one with the longer way moves at `max_velocity`, or
    slower if `min_duration` requires it. A point that moves is followed until the head arrives.

    Args:
        head: the head.
        start: desired states of pan and tilt at the beginning. A joint that moves brakes within
            0.2 s, while the motion to the point begins.
        max_velocity: of either joint [rad/s].
        min_duration: minimum duration [s].
        threshold: the largest miss that counts as arrived [rad].
        settle_time: the turn ends when the joints have stood still for this time [s], or have
            missed a moving point by less than `threshold` for this time.

    Attributes:
        head: as given.
        max_velocity: as given.
        miss: of the measured head [rad]; None before the first `aim`.
    """

    def __init__(
        self,
        head: PanTiltHead,
        start: tuple[JointPoint, JointPoint],
        max_velocity: float,
        min_duration: float,
        threshold: float,
        settle_time: float,
    ) -> None:
        self.head = head
        self.max_velocity = max_velocity
        self.miss: float | None = None
        pan, tilt = (point.velocity or 0.0 for point in start)
        self._velocity = pan, tilt
        # where the joints would stand if they only braked
        self._start = (
            start[0].position + 0.5 * _RAMP * pan,
            start[1].position + 0.5 * _RAMP * tilt,
        )
        self._min_duration = min_duration
        self._threshold = threshold
        self._settle_time = settle_time
        self._began = self._duration = 0.0
        self._gazes: deque[tuple[float, tuple[float, float]]] = deque()
        self._rate = (0.0, 0.0)
        self._seen = 0.0
        self._errors: deque[tuple[float, tuple[float, float]]] = deque()
        self._arrival = Arrival(threshold, settle_time)
        self._has_settled = False
        self._rest = (0.0, 0.0)
        self._still_since = 0.0

    def aim(
        self, point: Vector3, stamp: float | None, present: tuple[float, float], now: float
    ) -> Gaze:
        """Set the present point and return the gaze at it, or the nearest possible one.

        Args:
            point: shape (3,) [m], in the head's base frame.
            stamp: when it was there [s]; None: it does not move.
            present: measured positions of the joints [rad].
            now: the time [s].
        """
        gaze = self.head.gaze(point, *(self._gazes[-1][1] if self._gazes else present))
        positions = gaze.pan, gaze.tilt
        if self.miss is None:
            self._began = now
            longest = max(abs(b - a) for a, b in zip(self._start, positions, strict=True))
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
        self._has_settled = self._arrival.step(self.miss, now)
        error = present[0] - positions[0], present[1] - positions[1]
        self._errors.append((now, error))
        while len(self._errors) > 2 and self._errors[1][0] <= now - _ON_TARGET:
            self._errors.popleft()
        if any(abs(a - b) > _STILL for a, b in zip(present, self._rest, strict=True)):
            self._rest, self._still_since = present, now
        return gaze

    def positions(self, time: float) -> tuple[float, float]:
        """Return the desired pan and tilt at a time [s]."""
        elapsed = time - self._began
        ratio = self._ratio(elapsed)
        left = max(0.0, _RAMP - max(0.0, elapsed))  # s of braking
        ahead = min(max(time - self._seen, 0.0), _LEAD_TIME)
        pan, tilt = (
            start - 0.5 * velocity * left * left / _RAMP + ratio * (goal + ahead * rate - start)
            for start, velocity, goal, rate in zip(
                self._start, self._velocity, self._gazes[-1][1], self._rate, strict=True
            )
        )
        return self.head.pan_limits.clamp(pan), self.head.tilt_limits.clamp(tilt)

    def judge(self, now: float) -> PointingResult | None:
        """Return the result of the turn; None while it is in progress."""
        if self.miss is None or now < self._began + self._duration:
            return None
        since, first = self._errors[0]
        steady = now - since >= _ON_TARGET and all(
            abs(a - b) <= _STEADY for a, b in zip(first, self._errors[-1][1], strict=True)
        )
        if self.miss <= _SMALL_MISS * self._threshold and steady:
            return PointingResult(True, self.miss)
        if max(map(abs, self._rate)) > _STEADY:  # the target moves
            return PointingResult(True, self.miss) if self._has_settled else None
        if now - self._still_since < self._settle_time:
            return None
        return PointingResult(self.miss <= self._threshold, self.miss)

    def _ratio(self, elapsed: float) -> float:
        """Return the completed fraction of the way: a trapezoidal velocity profile."""
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
