"""Where the target is and how it moves, from stamped points that come as they please."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from head_tracking.parameters import parameter
from head_tracking.tracking.motion_filter import Motion, corrected, mixed
from head_tracking.tracking.target_estimate import TargetEstimate
from head_tracking.transforms import Vector3

# From a target that hardly changes its velocity to one that turns on the spot [1/s^5].
_AGILITIES = (2e3, 1e5, 5e6, 2e8)
# A new target is expected to be calm until it shows that it is not.
_FIRST_SCORES = (1.0, 1.5, 3.0, 10.0)

_HISTORY = 1.0  # s; a point may come so much later than the newest one
_MEMORY = 0.5  # s; over which the filters are judged
_SHARPNESS = 4  # how strongly the better filter wins
_USUAL_NOISE = 0.003  # rad; until the points have shown their own
_FINEST = 1e-6  # rad; noise below this is rounding
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
    """All filters after a point.

    Attributes:
        stamp: of the point [s].
        point: as measured [m].
        motions: one for each agility.
        scores: mean squared error of each one's predictions [m^2].
        variance: of the points along any axis [m^2].
        mixture: of the filters, the better ones counting more.
        agility: the same mixture of their agilities [1/s^5].
    """

    stamp: float
    point: Vector3
    motions: tuple[Motion, ...]
    scores: tuple[float, ...]
    variance: float
    mixture: Motion
    agility: float


class TargetEstimator:
    """A bank of Kalman filters, from sluggish to agile, mixed by how well each one predicts.

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
        self._history: list[_Snapshot] = []
        self._jumped: list[tuple[float, Vector3]] = []
        self._estimate: TargetEstimate | None = None

    @property
    def estimate(self) -> TargetEstimate | None:
        """What is known of the target; None before its first point."""
        return self._estimate

    def reset(self) -> None:
        """Forgets the target."""
        self._history.clear()
        self._jumped.clear()
        self._estimate = None

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
        history = self._history
        if not history or stamp - history[-1].stamp > self.parameters.target_timeout:
            return self._start([(stamp, point)])
        index = bisect_right(history, stamp, key=_stamp)
        if index == 0:
            return Verdict.TOO_OLD
        if history[index - 1].stamp == stamp:
            return Verdict.DOUBLED
        if self._is_jump(history[index - 1], stamp, point):
            return self._consider_jump(stamp, point)
        self._jumped.clear()
        later = history[index:]
        del history[index:]
        self._append(stamp, point)
        for snapshot in later:
            self._append(snapshot.stamp, snapshot.point)
        self._refresh()
        return Verdict.TAKEN

    def _start(self, points: Sequence[tuple[float, Vector3]]) -> Verdict:
        self.reset()
        for stamp, point in points:
            self._append(stamp, point)
        self._refresh()
        return Verdict.NEW_TARGET

    def _append(self, stamp: float, point: Vector3) -> None:
        history = self._history
        distance = math.hypot(*point)
        if not history:
            variance = (_USUAL_NOISE * distance) ** 2
            motion = Motion.seen_once(point)
            scores = tuple(factor * variance for factor in _FIRST_SCORES)
            motions = (motion,) * len(_AGILITIES)
            history.append(_Snapshot(stamp, point, motions, scores, variance, motion, 0.0))
            return
        before = history[-1]
        dt = stamp - before.stamp
        motions, fits = zip(
            *(
                corrected(motion, dt, point, agility)
                for motion, agility in zip(before.motions, _AGILITIES, strict=True)
            ),
            strict=True,
        )
        share = 1.0 - math.exp(-dt / _MEMORY)
        finest = (_FINEST * distance) ** 2
        scores = self._judged(before.scores, share, stamp, point, finest)
        weights = _weights(scores)
        surprise = _mean(weights, fits) / 3.0
        variance = before.variance + share * (surprise - before.variance) + finest
        history.append(
            _Snapshot(
                stamp,
                point,
                motions,
                scores,
                variance,
                mixed(weights, motions),
                _mean(weights, _AGILITIES),
            )
        )
        if history[0].stamp < stamp - _HISTORY:
            del history[0]

    def _judged(
        self,
        scores: Sequence[float],
        share: float,
        stamp: float,
        point: Vector3,
        finest: float,
    ) -> tuple[float, ...]:
        """The scores after a point, which every filter should have predicted `horizon` ago."""
        history = self._history
        judged = history[max(0, bisect_right(history, stamp - self.horizon, key=_stamp) - 1)]
        ahead = stamp - judged.stamp
        return tuple(
            score
            + share * (_squared_distance(motion.position_after(ahead), point) - score)
            + finest
            for score, motion in zip(scores, judged.motions, strict=True)
        )

    def _is_jump(self, before: _Snapshot, stamp: float, point: Vector3) -> bool:
        expected = self._described(before)
        allowed = self.parameters.jump_threshold * math.hypot(*point)
        allowed += _DEVIATIONS * expected.deviation(stamp)
        return _squared_distance(expected.position(stamp), point) > allowed * allowed

    def _consider_jump(self, stamp: float, point: Vector3) -> Verdict:
        if self._jumped:
            last_stamp, last = self._jumped[-1]
            moved = self.parameters.jump_threshold + _FASTEST * (stamp - last_stamp)
            allowed = moved * math.hypot(*point)
            if stamp <= last_stamp or _squared_distance(last, point) > allowed * allowed:
                self._jumped.clear()
        self._jumped.append((stamp, point))
        if stamp - self._jumped[0][0] >= self.parameters.jump_confirmation:
            return self._start(tuple(self._jumped))
        return Verdict.JUMP

    def _refresh(self) -> None:
        self._estimate = self._described(self._history[-1])

    def _described(self, snapshot: _Snapshot) -> TargetEstimate:
        return TargetEstimate(
            snapshot.stamp,
            snapshot.point,
            snapshot.mixture,
            snapshot.variance,
            snapshot.agility,
            max(_SHORTEST_TRUST, _TRUST * self.horizon),
            self.parameters.target_timeout,
        )


def _stamp(snapshot: _Snapshot) -> float:
    return snapshot.stamp


def _squared_distance(one: Vector3, other: Vector3) -> float:
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return x * x + y * y + z * z


def _weights(scores: Sequence[float]) -> list[float]:
    best = min(scores)
    raw = [(best / score) ** _SHARPNESS for score in scores]
    total = sum(raw)
    return [weight / total for weight in raw]


def _mean(weights: Sequence[float], values: Sequence[float]) -> float:
    return sum(map(float.__mul__, weights, values))
