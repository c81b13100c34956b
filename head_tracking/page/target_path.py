"""Where a target was, and where the tracker expects it to go."""

from __future__ import annotations

import math

from head_tracking.gaze import Sight
from head_tracking.tracking import EstimatorParameters, TargetEstimator
from head_tracking.transforms import Vector3

_STEPS = 12
_RECEDING = 0.05  # 1/s: a target whose distance changes slower stands still
_CLOSE = 1e-3  # m
_MOVING = 0.01  # rad/s: slower targets stand still
_DEVIATIONS = 3.0  # of a speed; up to there a target may stand still as well


class TargetPath:
    """The tracker's own estimate of how its target moves on.

    Times are in nanoseconds; points are in one frame that stands still [m].

    Args:
        ahead: how far the prediction goes [s].
        head: where the head is: the estimator thinks in angles seen from there.
    """

    def __init__(self, ahead: float, head: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self._ahead = ahead
        self._head = head
        self._last: tuple[int, Vector3] | None = None
        self._estimator = TargetEstimator(EstimatorParameters())
        self._estimator.horizon = ahead
        self._now = 0

    def add(self, now: int, point: Vector3 | None, stamp: int | None = None) -> None:
        """Takes what is known of the target at the time `now`.

        Args:
            now: the time; if it jumps back, as in a recording that starts again, all begins anew.
            point: where the target was; None: there is no target.
            stamp: when it was there; None: now.
        """
        stamp = now if stamp is None else stamp
        if point is None or now < self._now:
            self._last = None
            self._estimator.reset()
        self._now = now
        if point is not None and (self._last is None or stamp > self._last[0]):
            self._take(stamp, point)

    def predicted(self) -> list[Vector3]:
        """The way from the last position on [m]; empty if the target stands still, for all we know.

        As the tracker expects it: the target moves on as it last moved, and comes to a stop if
        nothing more is heard of it.
        """
        estimate, now = self._estimator.estimate, self._now * 1e-9
        timeout = self._estimator.parameters.target_timeout
        if estimate is None or estimate.age(now) > timeout:
            return []
        moving = any(
            abs(speed) > max(_MOVING, _DEVIATIONS * estimate.speed_deviation(joint))
            for joint, speed in enumerate(estimate.velocity(estimate.stamp))
        )
        if not moving and abs(estimate.range.rate) < _RECEDING:
            return []
        step = (now + self._ahead - estimate.stamp) / _STEPS
        times = (estimate.stamp + number * step for number in range(_STEPS + 1))
        return [self._point(estimate.sight_at(time)) for time in times]

    def _take(self, stamp: int, point: Vector3) -> None:
        self._last = stamp, point
        sight = self._sight(point)
        if sight is not None:
            self._estimator.add(stamp * 1e-9, sight, self._now * 1e-9)

    def _sight(self, point: Vector3) -> Sight | None:
        """Azimuth, angle below the horizon and distance of a point, from the head."""
        x, y, z = (a - b for a, b in zip(point, self._head, strict=True))
        distance = math.hypot(x, y, z)
        if distance < _CLOSE:
            return None
        last = self._estimator.estimate
        before = 0.0 if last is None else last.sight.pan
        azimuth = before + math.remainder(math.atan2(y, x) - before, math.tau)
        return Sight(azimuth, -math.asin(z / distance), distance)

    def _point(self, sight: Sight) -> Vector3:
        x, y, z = self._head
        flat = sight.distance * math.cos(sight.tilt)
        return (
            x + flat * math.cos(sight.pan),
            y + flat * math.sin(sight.pan),
            z - sight.distance * math.sin(sight.tilt),
        )
