"""The predicted path of a target, by the estimator of the tracker."""

from __future__ import annotations

import math

from head_tracking.gaze import Ray
from head_tracking.tracking import EstimatorParameters, TargetEstimator
from head_tracking.transforms import Vector3

_STEPS = 12
_RECEDING = 0.05  # 1/s: a smaller relative change of the distance is no motion
_CLOSE = 1e-3  # m
_MOVING = 0.01  # rad/s: a slower target is at rest
_DEVIATIONS = 3.0  # of the speed, below which a target may be at rest


class TargetPath:
    """Predicts the path of a target as the tracker does.

    Times are in nanoseconds; points are in one frame that stands still [m].

    Args:
        ahead: length of the prediction [s].
        head: position of the head: the estimator uses angles seen from there.
    """

    def __init__(self, ahead: float, head: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self._ahead = ahead
        self._head = head
        self._last: int | None = None
        self._estimator = TargetEstimator(EstimatorParameters())
        self._estimator.lead_time = ahead
        self._now = 0

    def add(self, now: int, point: Vector3 | None, stamp: int | None = None) -> None:
        """Add what is known of the target at the time `now`.

        Args:
            now: the time; if it jumps back, the estimate is reset.
            point: the target; None: there is none.
            stamp: when it was there; None: now.
        """
        stamp = now if stamp is None else stamp
        if point is None or now < self._now:
            self._last = None
            self._estimator.reset()
        self._now = now
        if point is not None and (self._last is None or stamp > self._last):
            self._last = stamp
            ray = self._ray(point)
            if ray is not None:
                self._estimator.add(stamp * 1e-9, ray, now * 1e-9)

    def predicted(self) -> list[Vector3]:
        """Return the path from the last position on [m]; empty if the target may be at rest."""
        estimate, now = self._estimator.estimate, self._now * 1e-9
        timeout = self._estimator.parameters.target_timeout
        if estimate is None or estimate.age(now) > timeout:
            return []
        moving = any(
            abs(speed) > max(_MOVING, _DEVIATIONS * estimate.speed_deviation(joint))
            for joint, speed in enumerate(estimate.velocities)
        )
        if not moving and abs(estimate.range.rate) < _RECEDING:
            return []
        step = (now + self._ahead - estimate.stamp) / _STEPS
        times = (estimate.stamp + number * step for number in range(_STEPS + 1))
        return [self._point(estimate.ray_at(time)) for time in times]

    def _ray(self, point: Vector3) -> Ray | None:
        """Return azimuth, angle below the horizon and distance of a point, from the head."""
        x, y, z = (a - b for a, b in zip(point, self._head, strict=True))
        distance = math.hypot(x, y, z)
        if distance < _CLOSE:
            return None
        last = self._estimator.estimate
        before = 0.0 if last is None else last.ray.pan
        azimuth = before + math.remainder(math.atan2(y, x) - before, math.tau)
        return Ray(azimuth, -math.asin(z / distance), distance)

    def _point(self, ray: Ray) -> Vector3:
        x, y, z = self._head
        flat = ray.distance * math.cos(ray.tilt)
        return (
            x + flat * math.cos(ray.pan),
            y + flat * math.sin(ray.pan),
            z - ray.distance * math.sin(ray.tilt),
        )
