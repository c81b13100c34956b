"""Where the target is and how it moves, from stamped sights that come as they please."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from head_tracking.gaze import Sight
from head_tracking.parameters import parameter
from head_tracking.tracking.multiple_model import Bearing, Gains, Motion

_HISTORY = 1.0  # s; a point may come so much later than the newest one
_USUAL_NOISE = 0.003  # rad; until the points have shown their own
_FUTURE = 0.5  # s; clocks that differ by more are set wrong
_FASTEST = 3.0  # rad/s; a target that has jumped must hold together like this to be believed
_DEVIATIONS = 3.0
_OUTLIER = 6.0  # standard deviations; of a point farther off only so much is taken at first
_KNOWN = 8  # points after which a target is known well enough for that
_SHORTEST_TRUST = 0.25  # s; over which an acceleration is believed
_TRUST = 1.3  # of the horizon

_FIRST_RANGE_NOISE = 0.02  # of a distance's logarithm
_LEAST_RANGE_NOISE = 1e-3
_FIRST_RANGE_RATE = 1.0  # 1/s
_RANGE_ACCELERATION = 0.5  # 1/s^3: white, in the logarithm
_RANGE_MEMORY = 1.0  # s; over which the noise is learned
_RANGE_OUTLIER = 9.0  # variances
_RANGE_OUTLIERS = 3  # in a row: the filter is wrong, not the points
_SMALLEST_RANGE = 1e-3  # m
_NEAREST = 0.3  # of the distance; so near a walker is taken to come
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
        0.06,
        "How long the points must stay at a new place to be believed.",
        unit="s",
        minimum=0.0,
        maximum=5.0,
    )


class Range(NamedTuple):
    """The distance of the target: a Kalman filter of its logarithm, which learns its noise.

    Attributes:
        log: of the distance in m.
        rate: its change [1/s].
        covariance: of both: pp, pv, vv.
        variance: of the measured logarithms.
        outliers: points in a row that were not used because they were too far off.
    """

    log: float
    rate: float
    covariance: tuple[float, float, float]
    variance: float
    outliers: int = 0

    @staticmethod
    def seen_once(distance: float) -> Range:
        """After one point [m]."""
        noise = _FIRST_RANGE_NOISE**2
        log = math.log(max(distance, _SMALLEST_RANGE))
        return Range(log, 0.0, (noise, 0.0, _FIRST_RANGE_RATE**2), noise)

    def after(self, dt: float, distance: float, turning: float) -> Range:
        """After another point [m], a time `dt` [s] later; the target turned so fast [rad/s]."""
        pp, pv, vv = self.covariance
        pp += dt * (2.0 * pv + dt * vv) + _RANGE_ACCELERATION * dt**3 / 3.0
        pv += dt * vv + 0.5 * _RANGE_ACCELERATION * dt * dt
        vv += _RANGE_ACCELERATION * dt
        away, aside = max(1.0 + self.rate * dt, _NEAREST), turning * dt
        square = away * away + aside * aside
        log = self.log + 0.5 * math.log(square)
        rate = (self.rate * away + turning * aside) / square
        off = math.log(max(distance, _SMALLEST_RANGE)) - log
        expected = pp + self.variance
        unexpected = min(off * off / expected, _RANGE_OUTLIER)
        share = 1.0 - math.exp(-dt / _RANGE_MEMORY)
        variance = max(self.variance * (1.0 + share * (unexpected - 1.0)), _LEAST_RANGE_NOISE**2)
        if unexpected == _RANGE_OUTLIER:
            if self.outliers + 1 >= _RANGE_OUTLIERS:
                return Range.seen_once(distance)
            return Range(log, rate, (pp, pv, vv), variance, self.outliers + 1)
        k, by_rate = pp / expected, pv / expected
        left = (pp - k * pp, pv - k * pv, vv - by_rate * pv)
        return Range(log + k * off, rate + by_rate * off, left, variance)

    @property
    def receding(self) -> float:
        """The change of the logarithm [1/s] as far as it can be told from noise."""
        square = self.rate * self.rate
        return self.rate * max(0.0, 1.0 - self.covariance[2] / square) if square else 0.0

    def distance(self, dt: float) -> float:
        """The distance [m] a time `dt` [s] later."""
        change = min(max(self.rate * dt, -_FARTHEST), _FARTHEST)
        return math.exp(self.log + change)


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """A target that moves on for a while as it last moved, and then comes to a stop.

    Attributes:
        stamp: time of the newest point [s].
        sight: the newest point as it was measured.
        motions: of pan and tilt, that look at the target, at `stamp`.
        range: its distance at `stamp`.
        noise: standard deviations of the points in pan and tilt [rad].
        certainty: variances of pan and tilt and of their velocities at `stamp` [rad^2].
        errors: mean squared errors of predictions over `horizon`, points' noise taken off [rad^2].
        horizon: the time over which these predictions went [s].
        trust: the time [s] over which the motion is believed.
        timeout: the target is taken to have come to a stop so long [s] after `stamp`.
    """

    stamp: float
    sight: Sight
    motions: tuple[Motion, Motion]
    range: Range
    noise: tuple[float, float]
    certainty: tuple[tuple[float, float], tuple[float, float]]
    errors: tuple[float, float]
    horizon: float
    trust: float
    timeout: float

    def age(self, now: float) -> float:
        """How long ago the newest point was measured [s]."""
        return now - self.stamp

    def bearing(self, time: float) -> tuple[float, float]:
        """Pan and tilt that look at the target [rad] at a time [s], as far as can be told."""
        (pan, _), (tilt, _) = self._moved(time)
        return pan, tilt

    def velocity(self, time: float) -> tuple[float, float]:
        """How pan and tilt that look at the target change [rad/s] at a time [s]."""
        (_, pan), (_, tilt) = self._moved(time)
        return pan, tilt

    def sight_at(self, time: float) -> Sight:
        """Where the target is at a time [s], as far as can be told."""
        (pan, _), (tilt, _) = self._moved(time)
        return Sight(pan, tilt, self.range.distance(min(time - self.stamp, self.trust)))

    def towards(self, time: float, sight: Sight, share: float) -> Sight:
        """A share of the way from where the target should be at a time [s] to where it is seen."""
        pan, tilt, distance = self.sight_at(time)
        return Sight(
            pan + share * (sight.pan - pan),
            tilt + share * (sight.tilt - tilt),
            distance + share * (sight.distance - distance),
        )

    def deviation(self, joint: int, time: float) -> float:
        """Standard deviation of that pan (0) or tilt (1) [rad] at a time [s].

        What the models say at the newest point, and what predictions have missed by, which grows
        with the time ahead.
        """
        here = self.certainty[joint][0]
        ahead = (time - self.stamp) / self.horizon
        return math.sqrt(here + max(self.errors[joint] - here, 0.0) * ahead * ahead)

    def speed_deviation(self, joint: int) -> float:
        """Standard deviation of the velocity of pan (0) or tilt (1) at `stamp` [rad/s]."""
        return math.sqrt(self.certainty[joint][1])

    def _moved(self, time: float) -> tuple[tuple[float, float], tuple[float, float]]:
        ahead = time - self.stamp
        if ahead <= self.trust:
            pan, tilt = self.motions
            return pan.after(ahead), tilt.after(ahead)
        fading = max(self.timeout - self.trust, 1e-3)
        beyond = min(ahead - self.trust, fading)
        way = beyond - 0.5 * beyond * beyond / fading  # the speed falls linearly to 0
        left = 1.0 - beyond / fading
        (x, u), (y, v) = (motion.after(self.trust) for motion in self.motions)
        return (x + way * u, left * u), (y + way * v, left * v)


class _Snapshot(NamedTuple):
    """What is known after a point."""

    gains: Gains
    bearings: tuple[Bearing, Bearing]
    range: Range


class _Suspect(NamedTuple):
    """A point far from where the target should be, of which a part was taken for the time being."""

    stamp: float
    sight: Sight
    before: TargetEstimate

    def confirmed(self, stamp: float, sight: Sight) -> bool:
        """Whether the next point is off to the same side, and about as far."""
        pan, tilt = self.before.bearing(self.stamp)
        first = self.sight.pan - pan, self.sight.tilt - tilt
        pan, tilt = self.before.bearing(stamp)
        along = first[0] * (sight.pan - pan) + first[1] * (sight.tilt - tilt)
        return along > 0.5 * (first[0] * first[0] + first[1] * first[1])


class TargetEstimator:
    """Estimates pan and tilt that look at the target, and its distance, each by itself.

    A camera measures bearings well and distances badly; so the noise of the one never gets into
    the others, and the estimate is as good in one direction as in another. Sights that come late
    are sorted in and what follows them is computed again.

    Times are in seconds on any clock.

    Attributes:
        parameters: may change at any time.
        horizon: how far ahead of the points predictions are needed [s].
    """

    def __init__(self, parameters: EstimatorParameters) -> None:
        self.parameters = parameters
        self.horizon = 0.1
        self._stamps: list[float] = []
        self._sights: list[Sight] = []
        self._pans: list[float] = []
        self._tilts: list[float] = []
        self._snapshots: list[_Snapshot] = []
        self._jumped: list[tuple[float, Sight]] = []
        self._suspect: _Suspect | None = None
        self._taken = 0
        self._estimate: TargetEstimate | None = None

    @property
    def estimate(self) -> TargetEstimate | None:
        """What is known of the target; None before its first point."""
        return self._estimate

    def reset(self) -> None:
        """Forgets the target."""
        self._jumped.clear()
        self._restart()

    def add(self, stamp: float, sight: Sight, now: float) -> Verdict:
        """Takes a point.

        Args:
            stamp: when the target was there [s].
            sight: pan, tilt and distance; pan may count full turns.
            now: the time [s].
        """
        if stamp > now + _FUTURE:
            return Verdict.FUTURE
        if now - stamp > self.parameters.target_timeout:
            return Verdict.TOO_OLD
        stamps = self._stamps
        if not stamps or stamp - stamps[-1] > self.parameters.target_timeout:
            return self._start([(stamp, sight)])
        index = bisect_right(stamps, stamp)
        if index == 0:
            return Verdict.TOO_OLD
        if stamps[index - 1] == stamp:
            return Verdict.DOUBLED
        if index < len(stamps):
            return self._sort_in(index, stamp, sight)
        self._resolve(stamp, sight)
        estimate = self._estimate
        assert estimate is not None
        away, unlikely = self._off(estimate, stamp, sight)
        farthest = max(estimate.deviation(joint, stamp) for joint in (0, 1))
        if away > self.parameters.jump_threshold + _DEVIATIONS * farthest:
            return self._consider_jump(stamp, sight)
        self._jumped.clear()
        if unlikely > _OUTLIER and self._taken >= _KNOWN:
            self._suspect = _Suspect(stamp, sight, estimate)
            sight = estimate.towards(stamp, sight, _OUTLIER / unlikely)
        self._append(stamp, sight)
        self._estimate = self._described(-1)
        return Verdict.TAKEN

    def _resolve(self, stamp: float, sight: Sight) -> None:
        """Whether a point far from where the target should be was true: this one tells."""
        suspect = self._suspect
        if suspect is None:
            return
        self._suspect = None
        self._cut(len(self._stamps) - 1)
        before = suspect.before
        if self._off(before, stamp, sight)[1] > _OUTLIER and suspect.confirmed(stamp, sight):
            self._append(suspect.stamp, suspect.sight)
        self._estimate = self._described(-1)

    def _sort_in(self, index: int, stamp: float, sight: Sight) -> Verdict:
        away, _ = self._off(self._described(index - 1), stamp, sight)
        if away > self.parameters.jump_threshold:
            return Verdict.JUMP
        later = list(zip(self._stamps[index:], self._sights[index:], strict=True))
        self._cut(index)
        for each in ((stamp, sight), *later):
            self._append(*each)
        self._estimate = self._described(-1)
        return Verdict.TAKEN

    def _cut(self, index: int) -> None:
        """Drops the points from this one on."""
        del self._stamps[index:], self._sights[index:], self._snapshots[index:]
        del self._pans[index:], self._tilts[index:]

    def _restart(self) -> None:
        self._cut(0)
        self._suspect = self._estimate = None
        self._taken = 0

    def _start(self, sights: Sequence[tuple[float, Sight]]) -> Verdict:
        self._restart()
        for stamp, sight in sights:
            self._append(stamp, sight)
        self._jumped.clear()
        self._estimate = self._described(-1)
        return Verdict.NEW_TARGET

    def _append(self, stamp: float, sight: Sight) -> None:
        stamps, snapshots = self._stamps, self._snapshots
        stamps.append(stamp)
        self._sights.append(sight)
        self._pans.append(sight.pan)
        self._tilts.append(sight.tilt)
        self._taken += 1
        if not snapshots:
            gains = Gains.seen_once()
            pan, tilt = (
                Bearing.seen_once(angle, _USUAL_NOISE, gains) for angle in (sight.pan, sight.tilt)
            )
            snapshots.append(_Snapshot(gains, (pan, tilt), Range.seen_once(sight.distance)))
            return
        before = snapshots[-1]
        dt = stamp - stamps[-2]
        index = min(max(bisect_right(stamps, stamp - self.horizon) - 1, 0), len(snapshots) - 1)
        judged, ahead = snapshots[index].bearings, stamp - stamps[index]
        gains = before.gains.after(dt)
        turning = math.hypot(*(bearing.motion.after(0.0)[1] for bearing in before.bearings))
        distance = before.range.after(dt, sight.distance, turning)
        pan, tilt = (
            bearing.after(stamps, angles, gains, distance.receding, earlier, ahead)
            for bearing, angles, earlier in zip(
                before.bearings, (self._pans, self._tilts), judged, strict=True
            )
        )
        snapshots.append(_Snapshot(gains, (pan, tilt), distance))
        if stamps[0] < stamp - _HISTORY:
            del stamps[0], self._sights[0], self._pans[0], self._tilts[0], snapshots[0]

    @staticmethod
    def _off(before: TargetEstimate, stamp: float, sight: Sight) -> tuple[float, float]:
        """How far a point is from where it should be: [rad], and in standard deviations."""
        pan, tilt = before.bearing(stamp)
        offs = sight.pan - pan, sight.tilt - tilt
        likely = [
            off / math.hypot(before.deviation(joint, stamp), before.noise[joint])
            for joint, off in enumerate(offs)
        ]
        return math.hypot(offs[0] * math.cos(tilt), offs[1]), math.hypot(*likely)

    def _near(self, stamp: float, sight: Sight, later: float, other: Sight) -> bool:
        """Whether two points may be the same target."""
        allowed = self.parameters.jump_threshold + _FASTEST * (later - stamp)
        pan = (other.pan - sight.pan) * math.cos(sight.tilt)
        return stamp < later and math.hypot(pan, other.tilt - sight.tilt) <= allowed

    def _consider_jump(self, stamp: float, sight: Sight) -> Verdict:
        if self._jumped and not self._near(*self._jumped[-1], stamp, sight):
            self._jumped.clear()
        self._jumped.append((stamp, sight))
        if stamp - self._jumped[0][0] >= self.parameters.jump_confirmation:
            return self._start(tuple(self._jumped))
        return Verdict.JUMP

    def _described(self, index: int) -> TargetEstimate:
        """The estimate after one of the points."""
        snapshot = self._snapshots[index]
        pan, tilt = snapshot.bearings
        return TargetEstimate(
            self._stamps[index],
            self._sights[index],
            (pan.motion, tilt.motion),
            snapshot.range,
            (math.sqrt(pan.variance), math.sqrt(tilt.variance)),
            (pan.certainty, tilt.certainty),
            (pan.error - pan.variance, tilt.error - tilt.variance),
            self.horizon,
            max(_SHORTEST_TRUST, _TRUST * self.horizon),
            self.parameters.target_timeout,
        )
