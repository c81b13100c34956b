"""Estimate where the target is and how it moves, from stamped rays in any order."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from head_tracking.compatibility import StrEnum
from head_tracking.gaze import Sight
from head_tracking.parameters import parameter
from head_tracking.tracking.multiple_model import Bearing, Bearings

_HISTORY = 1.0  # s; a point may come so much later than the newest one
_FUTURE = 0.5  # s; clocks that differ by more are set wrong
_FEWEST = 8  # points that are kept, however old
_NEAR = 0.5  # of `jump_threshold`; so near the prediction a point is used, if the last one was
_FASTEST = 1.5  # rad/s; suspects that are farther apart than this do not confirm each other
_STAYED = 0.7  # s; who has stayed somewhere for so long and jumped away may come back
_RETURN = 10.0  # s; within this,
_SAME = 0.5  # of `jump_threshold`: so near to that place
_JUMP, _JUMP_SPEED = 2.0, 0.5  # times the speed since, and rad/s: a faster way was a jump
_LEAST_ERROR = 0.1  # of the variance of a point; no prediction is better
_OVERDUE = 0.45  # s; so much longer than usual is predicted when points are overdue
_CAUTION = 0.5  # of the mean squared error of far predictions: it shortens their way
_FINEST = 1e-12  # rad^2; less is rounding
_FARTHEST_AHEAD = 1.0  # rad; the field of view of a camera

_RANGE_MEMORY = 0.5  # s
_RANGE_OUTLIER = 0.3  # of the logarithm; no more of a difference is believed
_SMALLEST_RANGE = 1e-3  # m
_FARTHEST = 0.5  # in the logarithm: so far a change is believed ahead


class Verdict(StrEnum):
    """What became of a point."""

    TAKEN = "taken"
    NEW_TARGET = "the target is new"
    JUMP = "the target seems to have jumped; the next points will tell"
    DOUBLED = "the point has come before"
    TOO_OLD = "the point is too old"
    TOO_CLOSE = "the point is too close: no turn of the head brings it before the camera"
    IGNORED = "tracking is switched off"
    FUTURE = "the point lies in the future; the clocks of its sender and of this machine differ"
    NOT_FINITE = "the point is not finite"

    @property
    def used(self) -> bool:
        """Whether the estimate has taken the point in."""
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


class Range(NamedTuple):
    """The distance of the target: a critically damped alpha-beta filter of its logarithm.

    Attributes:
        log: of the distance in m.
        rate: its change [1/s].
    """

    log: float
    rate: float = 0.0

    @staticmethod
    def seen_once(distance: float) -> Range:
        """Return what one point tells [m]."""
        return Range(math.log(max(distance, _SMALLEST_RANGE)))

    def after(self, dt: float, distance: float) -> Range:
        """Return what another point [m] tells, a time `dt` [s] later."""
        log = self.log + self.rate * dt
        off = math.log(max(distance, _SMALLEST_RANGE)) - log
        off = math.copysign(min(abs(off), _RANGE_OUTLIER), off)
        kept = math.exp(-dt / _RANGE_MEMORY)
        return Range(log + (1.0 - kept * kept) * off, self.rate + (1.0 - kept) ** 2 / dt * off)

    def distance(self, dt: float) -> float:
        """Return the distance [m] a time `dt` [s] later."""
        change = min(max(self.rate * dt, -_FARTHEST), _FARTHEST)
        return math.exp(self.log + change)


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """A target that moves as predictions over such times have earned it, and then stands still.

    Attributes:
        stamp: time of the newest point [s].
        sight: the newest point as it was measured.
        range: its distance at `stamp`.
        bearings: of pan and tilt, that look at the target, at `stamp`.
        leads: the times over which the near and the far predictions of them go [s].
        reach: so long after `stamp` the target is taken to stand still [s].
    """

    stamp: float
    sight: Sight
    range: Range
    bearings: tuple[Bearing, Bearing]
    leads: tuple[float, float]
    reach: float

    @property
    def velocities(self) -> tuple[float, float]:
        """The velocities of pan and tilt that look at the target, at `stamp` [rad/s]."""
        pan, tilt = self.bearings
        return pan.near.motion.speed, tilt.near.motion.speed

    def age(self, now: float) -> float:
        """Return how long ago the latest point was measured [s]."""
        return now - self.stamp

    def bearing(self, time: float) -> tuple[float, float]:
        """Return pan and tilt that look at the target [rad] at a time [s], as predicted."""
        return self._position(0, time), self._position(1, time)

    def sight_at(self, time: float, tilt_time: float | None = None) -> Sight:
        """Return the predicted ray at a time [s]; its tilt, if given, at another."""
        pan = self._position(0, time)
        tilt = self._position(1, time if tilt_time is None else tilt_time)
        return Sight(pan, tilt, self.range.distance(min(time - self.stamp, self.reach)))

    def deviation(self, joint: int, time: float) -> float:
        """Return the standard deviation of pan (0) or tilt (1) [rad] at a time [s].

        By what predictions have missed by, which grows with the time ahead; at the newest point
        the models' own account, unless that is larger.
        """
        bearing, (lead, far) = self.bearings[joint], self.leads
        least = _LEAST_ERROR * bearing.variance
        near_error = max(bearing.near.error - bearing.variance, least)
        here = min(bearing.certainty[0], near_error)
        ahead = time - self.stamp
        if ahead <= lead:
            return math.sqrt(here + (near_error - here) * (ahead / lead) ** 2)
        far_error = max(bearing.far.error - bearing.variance, near_error)
        return math.sqrt(near_error + (far_error - near_error) * (ahead - lead) / (far - lead))

    def speed_deviation(self, joint: int) -> float:
        """Standard deviation of the velocity of pan (0) or tilt (1) at `stamp` [rad/s]."""
        return math.sqrt(self.bearings[joint].certainty[1])

    def _position(self, joint: int, time: float) -> float:
        """Return pan (0) or tilt (1) [rad] at a time [s].

        Beyond the lead time the far prediction takes over; the error of the far predictions until
        now shortens the way beyond the latest point.
        """
        bearing, (lead, far) = self.bearings[joint], self.leads
        ahead = min(time - self.stamp, self.reach)
        here = bearing.near.motion.position
        away = bearing.near.motion.after(ahead) - here
        if ahead > lead:
            share = ((ahead - lead) / (far - lead)) ** 2
            away += share * (bearing.far.motion.after(ahead) - here - away)
            missed = bearing.far.error - max(bearing.near.error, bearing.variance)
            squares = away * away + share * _CAUTION * max(missed, 0.0) + _FINEST
            away *= away * away / squares
        return here + min(max(away, -_FARTHEST_AHEAD), _FARTHEST_AHEAD)


class _Snapshot(NamedTuple):
    """What is known after a point.

    Attributes:
        stamp: of the point [s].
        sight: the point.
        bearings: of the target.
        range: its distance.
    """

    stamp: float
    sight: Sight
    bearings: Bearings
    range: Range


def _line(a: tuple[float, Sight], b: tuple[float, Sight], time: float) -> Sight:
    """Return where a target is at a time [s] that moves steadily through two points."""
    (start, first), (end, last) = a, b
    ratio = (time - start) / (end - start)
    pan = first.pan + ratio * (last.pan - first.pan)
    return Sight(pan, first.tilt + ratio * (last.tilt - first.tilt), last.distance)


class TargetEstimator:
    """Estimates pan and tilt that look at the target, and its distance, each by itself.

    A camera measures bearings well and distances badly; so the noise of the one never gets into
    the others, and the estimate is as good in one direction as in another. Sights that come late
    are sorted in and what follows them is computed again.

    Times are in seconds on any clock.

    Args:
        parameters: what counts as the same target.
        level: tilt [rad] at which the head points along the horizon; the angle between two rays
            that differ in pan depends on their elevation.

    Attributes:
        parameters: may change at any time.
        horizon: how far ahead of the points predictions are needed [s].
    """

    def __init__(self, parameters: EstimatorParameters, level: float = 0.0) -> None:
        self.parameters = parameters
        self._level = level
        self.horizon = 0.1
        self._stamps: list[float] = []
        self._pans: list[float] = []
        self._tilts: list[float] = []
        self._snapshots: list[_Snapshot] = []
        self._suspects: list[tuple[float, Sight]] = []
        self._left: tuple[float, Sight] | None = None
        self._began = self._off = 0.0
        self._estimate: TargetEstimate | None = None

    @property
    def estimate(self) -> TargetEstimate | None:
        """What is known of the target; None before its first point."""
        return self._estimate

    def reset(self) -> None:
        """Forget the target."""
        self._suspects.clear()
        self._left = None
        self._cut(0)
        self._estimate = None

    def add(self, stamp: float, sight: Sight, now: float) -> Verdict:
        """Takes a point.

        Args:
            stamp: when the target was there [s].
            sight: pan, tilt and distance; pan may count full turns.
            now: the time [s].
        """
        if not all(map(math.isfinite, (stamp, *sight))):
            return Verdict.NOT_FINITE
        if stamp > now + _FUTURE:
            return Verdict.FUTURE
        if now - stamp > self.parameters.target_timeout:
            return Verdict.TOO_OLD
        stamps = self._stamps
        if not stamps or stamp - stamps[-1] > self.parameters.target_timeout:
            self._suspects.clear()
            self._begin([(stamp, sight)], self._snapshots[-1] if stamps else None)
            verdict = Verdict.NEW_TARGET
        else:
            index = bisect_right(stamps, stamp)
            if index == 0:
                return Verdict.TOO_OLD
            if stamps[index - 1] == stamp:
                return Verdict.DOUBLED
            verdict = self._judge(index, stamp, sight)
        if verdict.used:
            self._estimate = self._described(-1)
        return verdict

    def _judge(self, index: int, stamp: float, sight: Sight) -> Verdict:
        """Use a point that comes at this place among the others, or suspect it."""
        estimate = self._estimate
        if estimate is None or estimate.stamp != self._stamps[index - 1]:
            estimate = self._described(index - 1)
        away = self._angle(sight, Sight(*estimate.bearing(stamp), sight.distance))
        if away <= _NEAR * self.parameters.jump_threshold + self._off:
            self._off = away  # one that was off widens the gate
            self._suspects = [each for each in self._suspects if each[0] > stamp]
            self._insert(stamp, sight)
            return Verdict.TAKEN
        timeout = self.parameters.target_timeout
        suspects = [each for each in self._suspects if abs(stamp - each[0]) < timeout]
        if any(each[0] == stamp for each in suspects):
            return Verdict.DOUBLED
        self._suspects = [*suspects, (stamp, sight)]
        alike = self._confirming(estimate, suspects, (stamp, sight))
        points = sorted((*alike, (stamp, sight)))
        confirmation = min(self.parameters.jump_confirmation, 0.5 * timeout)
        if self._returns(stamp, sight):
            points = [(stamp, sight)]
        elif not alike or points[-1][0] - points[0][0] < confirmation:
            return Verdict.JUMP
        self._suspects.clear()
        if self._jumped(estimate, points):
            self._restart(points)
            return Verdict.NEW_TARGET
        for point in points:
            self._insert(*point)
        return Verdict.TAKEN

    def _confirming(
        self,
        before: TargetEstimate,
        suspects: list[tuple[float, Sight]],
        newest: tuple[float, Sight],
    ) -> list[tuple[float, Sight]]:
        """Return the suspects by which a further one is believed; empty: none.

        Two that are far apart are believed as a motion that goes on, but not after a jump: two
        false detections look like that.
        """
        threshold, (stamp, sight) = self.parameters.jump_threshold, newest
        alike = [each for each in suspects if self._angle(each[1], sight) < threshold]
        if alike or not suspects:
            return alike
        then, last = suspects[-1]
        is_slow = self._angle(last, sight) < _FASTEST * abs(stamp - then)
        if is_slow and not self._jumped(before, sorted((suspects[-1], newest))):
            return suspects[-1:]
        line = suspects[-2:]
        if len(line) > 1 and self._angle(_line(line[0], line[1], stamp), sight) < threshold:
            return line
        return []

    def _returns(self, stamp: float, sight: Sight) -> bool:
        """Return whether the target is where it stayed before its last jump: two take turns."""
        if self._left is None or stamp - self._left[0] > _RETURN:
            return False
        return self._angle(self._left[1], sight) < _SAME * self.parameters.jump_threshold

    def _restart(self, points: Sequence[tuple[float, Sight]]) -> None:
        """Start anew from points that are believed, and judge later ones by them."""
        index = max(bisect_right(self._stamps, points[0][0]), 1)
        before = self._snapshots[index - 1]
        later = [(each.stamp, each.sight) for each in self._snapshots[index:]]
        stayed = before.stamp - self._began > _STAYED
        self._left = (before.stamp, before.sight) if stayed else None
        self._begin(points, before)
        for stamp, sight in later:
            place = bisect_right(self._stamps, stamp)
            if place:
                self._judge(place, stamp, sight)

    def _jumped(self, before: TargetEstimate, points: Sequence[tuple[float, Sight]]) -> bool:
        """Return whether the way to these points was no part of the motion that they show."""
        (stamp, first), (end, last) = points[0], points[-1]
        speed = self._angle(before.sight, first) / max(stamp - before.stamp, 1e-3)
        since = self._angle(first, last) / max(end - stamp, 1e-3)
        return speed > _JUMP * since + _JUMP_SPEED

    def _cut(self, index: int) -> None:
        """Drop the points from this one on."""
        for each in (self._stamps, self._pans, self._tilts, self._snapshots):
            del each[index:]

    def _begin(self, points: Sequence[tuple[float, Sight]], before: _Snapshot | None) -> None:
        """Start with points that have nothing to do with the motion before."""
        self._cut(0)
        (stamp, sight), *others = points
        bearing = sight.pan, sight.tilt
        bearings = (
            Bearings.seen_once(bearing, self._leads)
            if before is None
            else before.bearings.restarted(bearing)
        )
        self._began, self._off, self._estimate = stamp, 0.0, None
        self._append(stamp, sight, bearings)
        for each in others:
            self._append(*each)

    def _insert(self, stamp: float, sight: Sight) -> None:
        """Sort a point in and compute anew what follows it."""
        index = bisect_right(self._stamps, stamp)
        later = [(each.stamp, each.sight) for each in self._snapshots[index:]]
        self._cut(index)
        for each in ((stamp, sight), *later):
            self._append(*each)

    def _append(self, stamp: float, sight: Sight, bearings: Bearings | None = None) -> None:
        """Take the next point; with `bearings` it is the first of a motion."""
        stamps, snapshots = self._stamps, self._snapshots
        stamps.append(stamp)
        self._pans.append(sight.pan)
        self._tilts.append(sight.tilt)
        if bearings is not None:
            distance = Range.seen_once(sight.distance)
        else:
            before = snapshots[-1]
            judged = [self._before(stamp - lead) for lead in self._leads]
            distance = before.range.after(stamp - before.stamp, sight.distance)
            bearings = before.bearings.after(
                stamps,
                (self._pans, self._tilts),
                [(each.bearings, stamp - each.stamp) for each in judged],
            )
        snapshots.append(_Snapshot(stamp, sight, bearings, distance))
        while len(stamps) > _FEWEST and stamps[0] < stamp - _HISTORY:
            del stamps[0], self._pans[0], self._tilts[0], snapshots[0]

    def _before(self, time: float) -> _Snapshot:
        """Return what was known at a time [s]; the first that is known, if it is too old."""
        return self._snapshots[
            max(bisect_right(self._stamps, time, hi=len(self._snapshots)) - 1, 0)
        ]

    @property
    def _leads(self) -> tuple[float, float]:
        """The times over which predictions are needed, usually and when points are overdue [s]."""
        return self.horizon, self.horizon + min(_OVERDUE, self.parameters.target_timeout)

    def _angle(self, a: Sight, b: Sight) -> float:
        """The angle between two rays that are near each other [rad]."""
        elevation = 0.5 * (a.tilt + b.tilt) - self._level
        return math.hypot((a.pan - b.pan) * math.cos(elevation), a.tilt - b.tilt)

    def _described(self, index: int) -> TargetEstimate:
        """The estimate after one of the points."""
        stamp, sight, bearings, distance = self._snapshots[index]
        leads = self._leads
        reach = min(leads[1], stamp - self._began)
        return TargetEstimate(stamp, sight, distance, bearings.joints, leads, reach)
