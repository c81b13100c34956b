"""Estimate where the target is and how it moves, from stamped rays in any order."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

from head_tracking.compatibility import StrEnum
from head_tracking.gaze import Ray
from head_tracking.parameters import parameter
from head_tracking.tracking.multiple_model import ACCELERATION, Bearing, Bearings

_HISTORY = 1.0  # s; a point may be older than now, and than the latest one, by this
_FUTURE = 0.5  # s; larger differences between clocks are errors
_FEWEST = 8  # points that are kept whatever their age
_NEAR = 0.45  # of `jump_threshold`: a point is used if it is so near to the prediction,
_LIKELY = 1.25  # plus this number of its standard deviations,
_WIDEST = 2.5  # and at most this times `jump_threshold`
_FASTEST = 1.5  # rad/s; no single point and no two suspects tell of a faster motion
_SCATTER = 4.0  # standard deviations of a point: two at one place are nearer to each other
_STAYED = 0.7  # s; who has stayed somewhere for so long and jumped away may come back
_RETURN = 10.0  # s; within this,
_SAME = 0.5  # of `jump_threshold`: so near to that place
_UNCONTRADICTED = 0.2  # s; a suspect of a lost target is believed if no point came for so long
_JUMP, _JUMP_SPEED = 2.0, 0.5  # times the speed since, plus rad/s: faster motion is a jump
_LEAST_ERROR = 0.1  # of the variance of a point: least variance of a prediction
_OVERDUE = 0.45  # s; prediction beyond the lead time while points are overdue
_CAUTION = 0.5  # of the mean squared error so far ahead, which shortens a prediction
_FINEST = 1e-12  # rad^2; avoids a division by 0
_FARTHEST_AHEAD = 1.0  # rad; the field of view of a camera
_IN_VIEW = 0.4  # rad from its axis a camera sees a target


Bounds: TypeAlias = tuple[float, float]
"""The lowest and the highest angle [rad]."""


class Verdict(StrEnum):
    """The result for a point."""

    TAKEN = "taken"
    NEW_TARGET = "the target is new"
    JUMP = "the target seems to have jumped; the next points will tell"
    DOUBLED = "a point with this stamp has come before; each needs the time at which it was seen"
    TOO_OLD = "the point is too old; it came late, or the clocks of two machines differ"
    TOO_CLOSE = "no turn of the head brings the point before the camera: too close?"
    IGNORED = "tracking is switched off"
    FUTURE = "the point lies in the future; the clocks of its sender and of this machine differ"
    NOT_FINITE = "the point is not finite"
    STOPPED = "the point is from the time before resume; points need the time of now, or 0"

    @property
    def used(self) -> bool:
        """Whether the estimate uses the point."""
        return self in (Verdict.TAKEN, Verdict.NEW_TARGET)


@dataclass(frozen=True, slots=True)
class EstimatorParameters:
    """What counts as the same target."""

    target_timeout: float = parameter(
        0.5,
        "The head follows the prediction for so long after the last point; then the target is "
        "lost.",
        unit="s",
        minimum=0.1,
        maximum=60.0,
    )
    jump_threshold: float = parameter(
        0.1,
        "A point farther than this from where the target should be must be confirmed.",
        unit="rad",
        minimum=0.005,
        maximum=4.0,
    )
    jump_confirmation: float = parameter(
        0.03,
        "How long the points must stay at a new place to be believed.",
        unit="s",
        minimum=0.0,
        maximum=5.0,
    )


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """The estimated target and its prediction.

    Attributes:
        stamp: time of the latest point [s].
        ray: the latest point as measured.
        bearings: filters of the pan and tilt that look at the target, at `stamp`.
        leads: the usual lead time, and a longer one for points that are overdue [s].
        reach: the prediction stands still from this time after `stamp` on [s].
        bounds: the prediction goes no farther, for pan and for tilt [rad].
        turned: transforms a predicted ray into the base frame at its time [s], if the base moves.
    """

    stamp: float
    ray: Ray
    bearings: tuple[Bearing, Bearing]
    leads: tuple[float, float]
    reach: float
    bounds: tuple[Bounds, Bounds]
    turned: Callable[[Ray, float], Ray] | None = None

    def ray_at(self, time: float, tilt_time: float | None = None) -> Ray:
        """Return the predicted ray at a time [s]; its tilt, if given, at another."""
        later = time if tilt_time is None else tilt_time
        if self.turned is not None and later != time:
            return self.ray_at(time)._replace(tilt=self.ray_at(later).tilt)
        ray = Ray(self._position(0, time), self._position(1, later), self.ray.distance)
        return ray if self.turned is None else self.turned(ray, time)

    def deviation(self, joint: int, time: float) -> float:
        """Return the standard deviation of pan (0) or tilt (1) [rad] at a time [s].

        It comes from the errors of earlier predictions. At the latest point it is the models' own
        deviation, unless that is larger. While points are overdue, the target may accelerate.
        """
        bearing, (lead, far) = self.bearings[joint], self.leads
        least = _LEAST_ERROR * bearing.variance
        near_error = max(bearing.error - bearing.variance, least)
        here = min(bearing.certainty[0], near_error)
        ahead = time - self.stamp
        if ahead <= lead:
            return math.sqrt(here + (near_error - here) * (ahead / lead) ** 2)
        far_error = max(bearing.far_error - bearing.variance, near_error)
        overdue = ahead - lead
        grown = (far_error - near_error) * overdue / (far - lead)
        return math.sqrt(near_error + grown + (0.5 * ACCELERATION * overdue**2) ** 2)

    def within(self, limits: Sequence[tuple[float, float]]) -> TargetEstimate:
        """Return the target for joints that cannot follow its oscillation in full.

        A joint that is too slow for an oscillation lags behind it, and overshoots; one that
        follows a smaller oscillation in time misses the target by less.

        Args:
            limits: highest speed [rad/s] and acceleration [rad/s^2] of pan and of tilt.
        """
        pan, tilt = map(Bearing.within, self.bearings, limits)
        return replace(self, bearings=(pan, tilt))

    def spread(self, joint: int, time: float) -> tuple[float, float, float]:
        """Return how uncertain pan (0) or tilt (1) is at a time [s].

        Returns:
            Its standard deviation [rad], that of its velocity [rad/s], and that of a measured
            point [rad].
        """
        bearing, noise = self.bearings[joint], self.deviation(joint, time)
        speed_noise = math.sqrt(bearing.certainty[1])
        return noise, speed_noise, math.sqrt(bearing.variance)

    def _position(self, joint: int, time: float) -> float:
        """Return pan (0) or tilt (1) [rad] at a time [s].

        Beyond the lead time the errors of earlier predictions so far ahead shorten it.
        """
        bearing, (lead, far) = self.bearings[joint], self.leads
        ahead = min(time - self.stamp, self.reach)
        here = bearing.motion.position
        away = bearing.motion.after(ahead) - here
        if ahead > lead:
            share = ((ahead - lead) / (far - lead)) ** 2
            missed = bearing.far_error - max(bearing.error, bearing.variance)
            squares = away * away + share * _CAUTION * max(missed, 0.0) + _FINEST
            away *= away * away / squares
        lower, upper = self.bounds[joint]
        return min(max(here + away, lower), upper)


class _Snapshot(NamedTuple):
    """The state of all filters after a point at `stamp` [s]."""

    stamp: float
    ray: Ray
    bearings: Bearings


def _line(a: tuple[float, Ray], b: tuple[float, Ray], time: float) -> Ray:
    """Return the ray at a time [s] on the line through two points."""
    (start, first), (end, last) = a, b
    ratio = (time - start) / (end - start)
    pan = first.pan + ratio * (last.pan - first.pan)
    return Ray(pan, first.tilt + ratio * (last.tilt - first.tilt), last.distance)


def _in_view(angles: Sequence[float]) -> Bounds:
    """Return the range of angles from which a camera sees all of these [rad]."""
    lower, upper = max(angles) - _IN_VIEW, min(angles) + _IN_VIEW
    middle = 0.5 * (lower + upper)
    return min(lower, middle), max(upper, middle)


class TargetEstimator:
    """Estimate the pan and tilt that look at the target; its distance is that of the latest point.

    Late points are sorted in, and the filters run again from there.

    Times are in seconds on any clock.

    Args:
        parameters: what counts as the same target.
        level: tilt [rad] at which the head points along the horizon; the angle between two rays
            that differ in pan depends on their elevation.

    Attributes:
        parameters: may change at any time.
        lead_time: usual time from a point to the time for which it is predicted [s].
        estimate: the estimated target; None before its first point.
    """

    def __init__(self, parameters: EstimatorParameters, level: float = 0.0) -> None:
        self.parameters = parameters
        self._level = level
        self.lead_time = 0.1
        self._is_unsure = False
        self._stamps: list[float] = []
        self._pans: list[float] = []
        self._tilts: list[float] = []
        self._snapshots: list[_Snapshot] = []
        self._suspects: list[tuple[float, Ray]] = []
        self._left: tuple[float, Ray] | None = None
        self._began = self._suspected = 0.0
        self.estimate: TargetEstimate | None = None

    @property
    def rate(self) -> float:
        """The rate of the target's oscillation [rad/s]; 0: it does not oscillate."""
        return self._snapshots[-1].bearings.oscillation.rate if self._snapshots else 0.0

    def reset(self) -> None:
        """Forget the target."""
        self._suspects.clear()
        self._left = None
        self._cut(0)
        self.estimate = None

    def add(self, stamp: float, ray: Ray, now: float, *, is_unsure: bool = False) -> Verdict:
        """Add a point and return the result.

        Args:
            stamp: when the target was there [s].
            ray: pan, tilt and distance; pan may count full turns.
            now: the time [s].
            is_unsure: its place is uncertain while the head moves; so what the newest points tell
                is not used.
        """
        self._is_unsure = is_unsure
        if not all(map(math.isfinite, (stamp, *ray))):
            return Verdict.NOT_FINITE
        if stamp > now + _FUTURE:
            return Verdict.FUTURE
        if now - stamp > max(self.parameters.target_timeout, _HISTORY):
            return Verdict.TOO_OLD
        stamps = self._stamps
        if not stamps:
            self._begin([(stamp, ray)], None)
            verdict = Verdict.NEW_TARGET
        else:
            index = bisect_right(stamps, stamp)
            if index == 0:
                return Verdict.TOO_OLD
            if stamps[index - 1] == stamp:
                return Verdict.DOUBLED
            verdict = self._judge(index, stamp, ray)
        if verdict.used:
            self.estimate = self._described(-1)
        elif verdict is Verdict.JUMP:
            self._suspected = now
        return verdict

    def settle(self, now: float, *, is_lost: bool) -> bool:
        """Return whether the latest suspect is the new target, as no other point contradicts it.

        The target was lost with it, and it is one of several, or nearer to the latest used point
        than the prediction.

        Args:
            now: the time [s].
            is_lost: whether the target is lost.
        """
        if not self._suspects or not is_lost or now - self._suspected < _UNCONTRADICTED:
            return False
        assert self.estimate is not None
        latest = self._suspects[-1]
        last, predicted = self.estimate.ray, self.estimate.ray_at(now)
        is_nearer = self._angle(latest[1], last) < self._angle(predicted, last)
        if not is_nearer and len(self._suspects) == 1:
            return False
        self._begin([latest], self._snapshots[-1])
        self.estimate = self._described(-1)
        return True

    def in_view(self) -> TargetEstimate:
        """Return the estimate for a camera while points are missing. Call it only with an estimate.

        It is the usual one, or so far before it that a camera that looks at it also sees the latest
        used point and the points that were suspected since: the target may have stopped on its way.
        """
        assert self.estimate is not None
        last = self.estimate.ray
        suspects = [ray for _, ray in self._suspects if self._angle(ray, last) < _FARTHEST_AHEAD]
        pans, tilts, _ = zip(last, *suspects, strict=True)
        return replace(self.estimate, bounds=(_in_view(pans), _in_view(tilts)))

    def _judge(self, index: int, stamp: float, ray: Ray) -> Verdict:
        """Use or suspect a point whose place among the others is `index`."""
        if stamp - self._stamps[-1] > self.parameters.target_timeout:
            self._leave(index)
            self._begin([(stamp, ray)], self._snapshots[-1])
            return Verdict.NEW_TARGET
        estimate = self.estimate
        if estimate is None or estimate.stamp != self._stamps[index - 1]:
            estimate = self._described(index - 1)
        away = self._angle(ray, estimate.ray_at(stamp))
        threshold = self.parameters.jump_threshold
        spread = max(estimate.deviation(0, stamp), estimate.deviation(1, stamp))
        usual = self._stamps[index - 1] - self._stamps[index - 2] if index > 1 else math.inf
        turned = 0.5 * ACCELERATION * min(stamp - estimate.stamp, usual) ** 2
        most = _FASTEST * (stamp - self._stamps[index - 1])
        spread = min(_LIKELY * math.hypot(spread, turned), most)
        if away <= min(_NEAR * threshold + spread, _WIDEST * threshold):
            self._suspects = [each for each in self._suspects if each[0] > stamp]
            self._insert(stamp, ray)
            return Verdict.TAKEN
        timeout = self.parameters.target_timeout
        suspects = [each for each in self._suspects if abs(stamp - each[0]) < timeout]
        if any(each[0] == stamp for each in suspects):
            return Verdict.DOUBLED
        self._suspects = [*suspects, (stamp, ray)]
        alike = self._confirming(estimate, suspects, (stamp, ray))
        points = sorted((*alike, (stamp, ray)))
        confirmation = min(self.parameters.jump_confirmation, 0.5 * timeout)
        if self._returns(stamp, ray):
            points = [(stamp, ray)]
        elif not alike or points[-1][0] - points[0][0] < confirmation:
            return Verdict.JUMP
        self._suspects.clear()
        if self._jumped(estimate, points):
            self._restart(points)
            return Verdict.NEW_TARGET
        self._leave(index)
        for point in points:
            self._insert(*point)
        return Verdict.TAKEN

    def _confirming(
        self,
        before: TargetEstimate,
        suspects: list[tuple[float, Ray]],
        latest: tuple[float, Ray],
    ) -> list[tuple[float, Ray]]:
        """Return the suspects that confirm another one; empty: none.

        Two suspects that are not alike confirm a motion that goes on, but no jump and no way back:
        two false detections look like that.
        """
        threshold, (stamp, ray) = self.parameters.jump_threshold, latest
        noise = _SCATTER * math.sqrt(max(bearing.variance for bearing in before.bearings))
        alike = [
            each
            for each in suspects
            if self._angle(each[1], ray) < min(threshold, noise + _FASTEST * abs(stamp - each[0]))
        ]
        if alike or not suspects:
            return alike
        then, last = suspects[-1]
        pan, tilt = last.pan - before.ray.pan, last.tilt - before.ray.tilt
        goes_on = pan * (ray.pan - last.pan) + tilt * (ray.tilt - last.tilt) > 0.0
        is_slow = self._angle(last, ray) < _FASTEST * abs(stamp - then)
        if goes_on and is_slow and not self._jumped(before, sorted((suspects[-1], latest))):
            return suspects[-1:]
        line = suspects[-2:]
        if len(line) > 1 and self._angle(_line(line[0], line[1], stamp), ray) < threshold:
            return line
        return []

    def _returns(self, stamp: float, ray: Ray) -> bool:
        """Return whether the target is where it stayed before its last jump: two take turns."""
        if self._left is None or stamp - self._left[0] > _RETURN:
            return False
        return self._angle(self._left[1], ray) < _SAME * self.parameters.jump_threshold

    def _leave(self, index: int) -> None:
        """Remember where the target stayed until the point before `index`, if it did."""
        last = self._snapshots[index - 1]
        since = [each for each in self._snapshots[:index] if each.stamp > last.stamp - _STAYED]
        near = _SAME * self.parameters.jump_threshold
        stayed = last.stamp - self._began > _STAYED and all(
            self._angle(each.ray, last.ray) < near for each in since
        )
        self._left = (last.stamp, last.ray) if stayed else None

    def _restart(self, points: Sequence[tuple[float, Ray]]) -> None:
        """Start anew from confirmed points, and judge later points again."""
        index = max(bisect_right(self._stamps, points[0][0]), 1)
        later = [(each.stamp, each.ray) for each in self._snapshots[index:]]
        self._leave(index)
        self._begin(points, self._snapshots[index - 1])
        for stamp, ray in later:
            place = bisect_right(self._stamps, stamp)
            if place:
                self._judge(place, stamp, ray)

    def _jumped(self, before: TargetEstimate, points: Sequence[tuple[float, Ray]]) -> bool:
        """Return whether the target reached these points faster than it moves between them."""
        (stamp, first), (end, last) = points[0], points[-1]
        speed = self._angle(before.ray, first) / max(stamp - before.stamp, 1e-3)
        since = self._angle(first, last) / max(end - stamp, 1e-3)
        return speed > _JUMP * since + _JUMP_SPEED

    def _cut(self, index: int) -> None:
        """Drop the points from an index on."""
        for each in (self._stamps, self._pans, self._tilts, self._snapshots):
            del each[index:]

    def _begin(self, points: Sequence[tuple[float, Ray]], before: _Snapshot | None) -> None:
        """Start a new motion with these points."""
        self._cut(0)
        self._suspects.clear()
        (stamp, ray), *others = points
        bearing = ray.pan, ray.tilt
        bearings = (
            Bearings.seen_once(bearing, self._leads)
            if before is None
            else before.bearings.restarted(bearing, self._leads)
        )
        self._began, self.estimate = stamp, None
        self._append(stamp, ray, bearings)
        for each in others:
            self._append(*each)

    def _insert(self, stamp: float, ray: Ray) -> None:
        """Sort a point in, and run the filters again from there."""
        index = bisect_right(self._stamps, stamp)
        later = [(each.stamp, each.ray) for each in self._snapshots[index:]]
        self._cut(index)
        for each in ((stamp, ray), *later):
            self._append(*each)

    def _append(self, stamp: float, ray: Ray, bearings: Bearings | None = None) -> None:
        """Append a point; with `bearings` it is the first of a motion."""
        stamps, snapshots = self._stamps, self._snapshots
        stamps.append(stamp)
        self._pans.append(ray.pan)
        self._tilts.append(ray.tilt)
        if bearings is None:
            judged = [self._before(stamp - lead) for lead in self._leads]
            bearings = snapshots[-1].bearings.after(
                stamps,
                (self._pans, self._tilts),
                [(each.bearings, stamp - each.stamp) for each in judged],
                is_unsure=self._is_unsure,
            )
        snapshots.append(_Snapshot(stamp, ray, bearings))
        while len(stamps) > _FEWEST and stamps[0] < stamp - _HISTORY:
            del stamps[0], self._pans[0], self._tilts[0], snapshots[0]

    def _before(self, time: float) -> _Snapshot:
        """Return the state at a time [s], or the oldest one."""
        return self._snapshots[
            max(bisect_right(self._stamps, time, hi=len(self._snapshots)) - 1, 0)
        ]

    @property
    def _leads(self) -> tuple[float, float]:
        """The usual lead time, and a longer one for points that are overdue [s]."""
        return self.lead_time, self.lead_time + min(_OVERDUE, self.parameters.target_timeout)

    def _angle(self, a: Ray, b: Ray) -> float:
        """Return the angle between two rays near each other [rad]."""
        elevation = 0.5 * (a.tilt + b.tilt) - self._level
        return math.hypot((a.pan - b.pan) * math.cos(elevation), a.tilt - b.tilt)

    def _described(self, index: int) -> TargetEstimate:
        """Return the estimate after the point with this index."""
        stamp, ray, bearings = self._snapshots[index]
        leads = self._leads
        reach = min(leads[1], stamp - self._began)
        ahead = _FARTHEST_AHEAD
        bounds = (ray.pan - ahead, ray.pan + ahead), (ray.tilt - ahead, ray.tilt + ahead)
        return TargetEstimate(stamp, ray, bearings.joints, leads, reach, bounds)
