"""Where the target is and how it moves, from stamped points that come as they please."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from head_tracking.parameters import parameter
from head_tracking.tracking.motion_filter import AGILITIES, THE_RESTLESS, Array, Bank
from head_tracking.tracking.swing_rate import SwingRate
from head_tracking.tracking.target_estimate import Coordinate, TargetEstimate
from head_tracking.transforms import Vector3

# A new target is expected to be calm until it shows that it is not.
_FIRST_SCORES: Array = np.array((1.0, 3.0, 10.0, 4.0, 10.0))

_SWINGS = THE_RESTLESS + 1  # the first filter that swings
_HISTORY = 1.0  # s; a point may come so much later than the newest one
_MEMORY = 0.5  # s; over which the filters are judged
_SHARPNESS = 2  # how strongly the better filter wins
_USUAL_NOISE = 0.003  # rad; until the points have shown their own
_FINEST = 1e-6  # rad; noise below this is rounding
_ALARM = 0.15  # s; how long a filter stays doubted
_OUTLIER = 3.0  # standard deviations
_FUTURE = 0.5  # s; clocks that differ by more are set wrong
_FASTEST = 3.0  # rad/s; a target that has jumped must hold together like this to be believed
_DEVIATIONS = 3.0
_SHORTEST_TRUST = 0.25  # s; over which an acceleration is believed
_TRUST = 1.3  # of the horizon


class Verdict(StrEnum):
    """What became of a point."""

    TAKEN = "taken"
    NEW_TARGET = "the target is new"
    JUMP = "the target seems to have jumped; the next points will tell"
    DOUBLED = "the point has come before"
    TOO_OLD = "the point is too old"
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


class _Snapshot(NamedTuple):
    """All filters after a point; c coordinates, f filters.

    Attributes:
        bank: the filters.
        swing: how fast the coordinates swing.
        scores: mean squared error of each filter's predictions, shape (c, f) [m^2].
        variance: of the points, as the restless filter sees them, shape (c,)
            [m^2].
        surprise: of each filter at the point, in standard deviations, shape (c, f).
        alarm: how strongly each filter is to be doubted, shape (c, f).
        weights: of the filters, the better ones counting more, shape (c, f).
    """

    bank: Bank
    swing: SwingRate
    scores: Array
    variance: Array
    surprise: Array
    alarm: Array
    weights: Array


class TargetEstimator:
    """A bank of Kalman filters, mixed by how well each one predicts.

    Every filter is judged by its predictions over the time by which predictions are needed, so
    that a calm target gets a calm estimate and a wild one a quick one, whatever the noise. Points
    that come late are sorted in and what follows them is computed again.

    Times are in seconds on any clock; points are in one frame that stands still, shape (3,) [m],
    with the head near its origin.

    Attributes:
        parameters: may change at any time.
        horizon: how far ahead of the points predictions are needed [s].
    """

    def __init__(self, parameters: EstimatorParameters) -> None:
        self.parameters = parameters
        self.horizon = 0.1
        self._stamps: list[float] = []
        self._points: list[Array] = []
        self._snapshots: list[_Snapshot] = []
        self._jumped: list[tuple[float, Array]] = []
        self._estimate: TargetEstimate | None = None

    @property
    def estimate(self) -> TargetEstimate | None:
        """What is known of the target; None before its first point."""
        return self._estimate

    def reset(self) -> None:
        """Forgets the target."""
        self._jumped.clear()
        self._restart()

    def add(self, stamp: float, point: Vector3, now: float) -> Verdict:
        """Takes a point.

        Args:
            stamp: when the target was there [s].
            point: shape (3,) [m], finite.
            now: the time [s].
        """
        if stamp > now + _FUTURE:
            return Verdict.FUTURE
        if now - stamp > self.parameters.target_timeout:
            return Verdict.TOO_OLD
        seen, stamps = np.array(point), self._stamps
        if not stamps or stamp - stamps[-1] > self.parameters.target_timeout:
            return self._start([(stamp, seen)])
        index = bisect_right(stamps, stamp)
        if index == 0:
            return Verdict.TOO_OLD
        if stamps[index - 1] == stamp:
            return Verdict.DOUBLED
        if self._is_jump(index - 1, stamp, seen):
            return self._consider_jump(stamp, seen)
        self._jumped.clear()
        later = list(zip(stamps[index:], self._points[index:], strict=True))
        del stamps[index:], self._points[index:], self._snapshots[index:]
        for each in ((stamp, seen), *later):
            self._append(*each)
        self._estimate = self._described(-1)
        return Verdict.TAKEN

    def _restart(self) -> None:
        self._stamps.clear()
        self._points.clear()
        self._snapshots.clear()
        self._estimate = None

    def _start(self, points: Sequence[tuple[float, Array]]) -> Verdict:
        self._restart()
        for stamp, point in points:
            self._append(stamp, point)
        self._jumped.clear()
        self._estimate = self._described(-1)
        return Verdict.NEW_TARGET

    def _append(self, stamp: float, point: Array) -> None:
        stamps, snapshots = self._stamps, self._snapshots
        distance = max(math.hypot(*point), 1e-3)
        stamps.append(stamp)
        self._points.append(point)
        if not snapshots:
            variance = np.full(3, (_USUAL_NOISE * distance) ** 2)
            scores = variance[:, None] * _FIRST_SCORES
            bank, swing = Bank.seen_once(point), SwingRate.unknown(3)
            calm = np.zeros_like(scores)
            weights = _weights(scores, calm)
            snapshots.append(_Snapshot(bank, swing, scores, variance, calm, calm, weights))
            return
        before = snapshots[-1]
        dt = stamp - stamps[-2]
        swing = before.swing.learned(stamps, self._points, before.variance)
        bank, fits = before.bank.corrected(dt, swing.rate, point)
        share = 1.0 - math.exp(-dt / _MEMORY)
        finest = (_FINEST * distance) ** 2
        errors = self._prediction_errors(stamp, point, swing.rate)
        scores = before.scores + share * (errors - before.scores) + finest
        noise = np.minimum(fits[:, THE_RESTLESS] ** 2, _OUTLIER**2 * before.variance)
        variance = before.variance + share * (noise - before.variance) + finest
        surprise = fits / np.sqrt(before.variance)[:, None]
        alarm = _alarmed(before, surprise, dt)
        weights = _weights(scores, alarm)
        snapshots.append(_Snapshot(bank, swing, scores, variance, surprise, alarm, weights))
        if stamps[0] < stamp - _HISTORY:
            del stamps[0], self._points[0], snapshots[0]

    def _prediction_errors(self, stamp: float, point: Array, swing: Array) -> Array:
        """By how much each filter missed a point `horizon` before it, squared [m^2]."""
        index = max(0, bisect_right(self._stamps, stamp - self.horizon) - 1)
        index = min(index, len(self._snapshots) - 1)
        expected = self._snapshots[index].bank.positions_after(stamp - self._stamps[index], swing)
        return np.asarray((expected - point[:, None]) ** 2)

    def _is_jump(self, index: int, stamp: float, point: Array) -> bool:
        known = self._estimate if index == len(self._stamps) - 1 else None
        before = known or self._described(index)
        allowed = self.parameters.jump_threshold * math.hypot(*point)
        allowed += _DEVIATIONS * before.deviation(stamp)
        return math.dist(before.position(stamp), point) > allowed

    def _consider_jump(self, stamp: float, point: Array) -> Verdict:
        if self._jumped:
            last_stamp, last = self._jumped[-1]
            moved = self.parameters.jump_threshold + _FASTEST * (stamp - last_stamp)
            allowed = moved * math.hypot(*point)
            if stamp <= last_stamp or math.dist(last, point) > allowed:
                self._jumped.clear()
        self._jumped.append((stamp, point))
        if stamp - self._jumped[0][0] >= self.parameters.jump_confirmation:
            return self._start(tuple(self._jumped))
        return Verdict.JUMP

    def _described(self, index: int) -> TargetEstimate:
        """The estimate after one of the points."""
        snapshot, point = self._snapshots[index], self._points[index]
        weights, states = snapshot.weights[:, None], snapshot.bank.states
        steady = (weights[:, :, :_SWINGS] @ states[:, :_SWINGS])[:, 0].tolist()
        swinging = (weights[:, :, _SWINGS:] @ states[:, _SWINGS:])[:, 0].tolist()
        rates = snapshot.swing.rate.tolist()
        x, y, z = (
            Coordinate(p + q, v, a, u, b, w)
            for (p, v, a), (q, u, b), w in zip(steady, swinging, rates, strict=True)
        )
        # along any axis: the mean over the axes, each one with its own noise and its own filters
        shares = snapshot.weights * snapshot.variance[:, None] / 3.0
        covariances = snapshot.bank.covariances.reshape(-1, 9)
        pp, pv, pa, _, vv, va, _, _, aa = (shares.reshape(-1) @ covariances).tolist()
        return TargetEstimate(
            self._stamps[index],
            (float(point[0]), float(point[1]), float(point[2])),
            (x, y, z),
            math.sqrt(sum(snapshot.variance.tolist()) / 3.0),
            (pp, pv, pa, vv, va, aa),
            sum((shares @ AGILITIES).tolist()),
            max(_SHORTEST_TRUST, _TRUST * self.horizon),
            self.parameters.target_timeout,
        )


def _alarmed(before: _Snapshot, surprise: Array, dt: float) -> Array:
    """How strongly each filter is to be doubted now: two surprises in a row to the same side."""
    both = np.minimum(np.abs(surprise), np.abs(before.surprise))
    both[surprise * before.surprise < 0.0] = 0.0
    excess = np.maximum(both - _DEVIATIONS, 0.0) ** 2
    return np.asarray(np.maximum(excess, before.alarm * math.exp(-dt / _ALARM)))


def _weights(scores: Array, alarm: Array) -> Array:
    raw = (scores.min(axis=1, keepdims=True) / scores) ** _SHARPNESS
    raw *= np.exp(0.5 * (alarm.min(axis=1, keepdims=True) - alarm))
    return np.asarray(raw / raw.sum(axis=1, keepdims=True))
