"""Estimate the stamp error of a camera on the head, and detect wrongly mounted servos.

A point of such a camera is a ray. Its bearing follows from the joint positions at the time of the
image. Each hypothesis (a stamp error, a mounting of the servos) gives another bearing. Only under
the true hypothesis does the target move smoothly while the head turns.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking.hypothesis_bank import HypothesisBank
from head_tracking.tracking.joint_readings import JointReadings
from head_tracking.tracking.learned import KNOWN, LearnedValue
from head_tracking.tracking.target import HeadBase
from head_tracking.transforms import Rotation, Vector3

Array = npt.NDArray[np.float64]

_ERRORS: Array = np.concatenate([np.arange(-0.2, 0.301, 0.02), np.arange(0.35, 0.901, 0.05)])
"""Hypotheses of the stamp error [s]."""
_ZERO = int(np.abs(_ERRORS).argmin())
_RIGHT = 0.9  # prior probability that the stamps are right
_USUAL = 0.1  # s; scale of the Cauchy prior of their error otherwise
_LEAST_DEVIATION = 0.006  # s; limit set by the target's own motion
_WORTH = 0.025  # s; smaller errors are not corrected,
_CLEAR = 4.0  # nor errors below this number of deviations
_NEARBY = 0.1  # s; a larger change of the correction needs a larger difference of the scores:
_MORE = 60.0  # 1/s; for each second of change beyond that,
_CONTRADICTED = 20.0  # and at least this if the correction was confirmed
_EXACT = 0.03  # s; a correction with a smaller deviation is confirmed
_VIEW = 0.2  # rad; a third of the field of view of a webcam
_TELLING = 2.0  # rad/s; at lower speeds the stamp error is not observable
_SURE = 0.95  # probability of right stamps at which a correction is removed,
_BETTER = 3.0  # if their score is better by this

_TURNS: Array = np.array(
    [
        ((1, 0), (0, 1)),
        ((-1, 0), (0, 1)),
        ((1, 0), (0, -1)),
        ((-1, 0), (0, -1)),
        ((0, 1), (1, 0)),
        ((0, 1), (-1, 0)),
        ((0, -1), (1, 0)),
        ((0, -1), (-1, 0)),
    ],
    dtype=np.float64,
)
"""Camera pan and tilt for a turn of the pan servo, and of the tilt servo, for each mounting; the
first one is right."""
_NEAR: Array = np.arange(-0.1, 0.151, 0.025)
"""Hypotheses of the stamp error for wrong mountings [s]."""
_WAIT = -float(_ERRORS.min())  # s; later, the joint readings for a ray are complete
_WRONG = 7.0  # a wrong mounting whose score is better by this is reported
_EXCLUDED = 10.0  # a wrong mounting whose score is worse by this is excluded

_OTHERWISE = 0.02  # s; a larger change of the correction restarts the target estimator
_OFTEN, _SELDOM = 0.015, 0.12  # s between scored points: usually; once the error is confirmed
_LOOKED_BACK = 1.2  # s; points are scored if a joint
_TURNED = 0.02  # rad; has turned by this in that time
_KEPT = 8  # points that are kept from before the head turns
_RECENT, _MOST_RECENT = 1.0, 64  # s and points that are corrected again
_AHEAD = 1.0  # s; points stamped later than this after the latest reading are not scored
_SLOPE = 0.03  # s before and after a stamp, for the speed of a joint
_RANGE_SHARE = 0.2  # weight of a measured distance in the mean distance


class StampError(NamedTuple):
    """Estimate of the stamp error.

    Attributes:
        mean: [s]; above 0: the stamps are too late.
        deviation: standard deviation [s].
    """

    mean: float
    deviation: float


class HeadCamera:
    """Estimate the stamp error of a camera on the head and the mounting of its servos.

    Times are in seconds on the clock of the stamps.

    Args:
        head: the head that carries the camera.
        readings: readings of its joints.
        base: pose of the head's base frame; None: it does not move.

    Attributes:
        applied: stamp error that is corrected [s].
        fault: description of a wrong mounting; empty: none was found.
        waiting: rays to be scored: stamp [s] and point in camera axes [m].
        is_learning: whether points are scored.
    """

    def __init__(
        self, head: PanTiltHead, readings: JointReadings, base: HeadBase | None = None
    ) -> None:
        self.applied, self.fault, self.is_learning = 0.0, "", True
        self.waiting: deque[tuple[float, Vector3]] = deque()
        self._head, self._readings, self._base = head, readings, base
        self._came = self._judged = -math.inf
        self._range = math.nan
        self._first: Rotation | None = None
        self._deviation = math.inf  # of the applied error, when the points told it best
        self._recent: deque[tuple[float, Vector3]] = deque(maxlen=_MOST_RECENT)
        wrong = len(_TURNS) - 1
        self._errors = np.concatenate([_ERRORS, np.tile(_NEAR, wrong)])
        counts = [len(_ERRORS)] + wrong * [len(_NEAR)]
        self._mountings = np.repeat(np.arange(len(_TURNS)), counts)
        self._bank = HypothesisBank(len(self._errors), self._mountings > 0)
        self._believed = _moments(_PRIOR)

    @property
    def stamp_error(self) -> StampError:
        """The estimate from the points alone, without the prior."""
        return _moments(self._timing)

    @property
    def learned(self) -> LearnedValue:
        """The corrected stamp error."""
        deviation = max(min(self._deviation, self.stamp_error.deviation), _LEAST_DEVIATION)
        return LearnedValue(self.applied, "s", deviation, self._judged, KNOWN)

    @property
    def safe_speed(self) -> float:
        """The greatest speed [rad/s] at which an unknown stamp error does not lose the target.

        Within the possible error, the head turns by a part of the camera's field of view.
        """
        if self._came == -math.inf:
            return math.inf
        mean, deviation = self._believed
        return max(_VIEW / math.hypot(deviation, mean - self.applied), _TELLING)

    @property
    def _confirmed(self) -> bool:
        return self._deviation < _EXACT

    @property
    def _timing(self) -> Array:
        """Scores of the stamp errors with the right mounting."""
        return self._bank.scores[: len(_ERRORS)]

    def corrected(self, stamp: float, point: Vector3) -> tuple[float, Vector3]:
        """Accept a point; return its corrected stamp [s] and position [m].

        Args:
            stamp: stamp of the point [s].
            point: shape (3,) [m], in the fixed frame, transformed with the joints at `stamp`.
        """
        pan, tilt = self._readings.at(stamp)
        in_base = point if self._base is None else self._base.at(stamp).inverse() @ point
        ray = self._head.seen(in_base, pan, tilt)
        latest = self._readings.latest
        if latest is not None and self._came < stamp < latest.stamp + _AHEAD:
            self._came = stamp
            self._recent.append((stamp, ray))
            if self.is_learning:
                self.waiting.append((stamp, ray))
        return self._placed(stamp, ray) if self.applied else (stamp, point)

    def keep(self, before: HeadCamera) -> None:
        """Continue with the correction of an earlier instance."""
        self.applied, self._deviation = before.applied, before._deviation

    def forget_target(self) -> None:
        """Discard the points of the target, and keep the estimates."""
        self._recent.clear()

    def _placed(self, stamp: float, ray: Vector3) -> tuple[float, Vector3]:
        """Return the corrected stamp of a ray [s] and its point in the fixed frame [m]."""
        taken = stamp - self.applied
        pan, tilt = self._readings.at(taken)
        point = self._head.placed_in_base(ray, pan, tilt)
        return taken, point if self._base is None else self._base.at(taken) @ point

    def update(self, rate: float) -> list[tuple[float, Vector3]]:
        """Score the points whose joint readings are complete.

        Args:
            rate: of the target's oscillation [rad/s]; 0: none is known.

        Returns:
            If the correction has changed by more than 20 ms, the points of the last second with
            the new correction: stamps [s] and points in the fixed frame [m].
        """
        before = self.applied
        if self._judge(rate):
            self._believed = _moments(self._timing + _PRIOR)
            self._decide_error(self._timing)
            self._decide_mounting()
        latest = self._readings.latest
        if latest is None or abs(self.applied - before) < _OTHERWISE:
            return []
        return [self._placed(*ray) for ray in self._recent if ray[0] > latest.stamp - _RECENT]

    def _judge(self, rate: float) -> bool:
        """Score the rays whose joint readings are complete; return whether there were any.

        While the head does not move, the hypotheses do not differ, and rays are only kept.
        """
        waiting, judged = self.waiting, False
        latest = -math.inf if self._readings.latest is None else self._readings.latest.stamp
        if not waiting or waiting[0][0] + _WAIT > latest:
            return False
        turned = self._readings.ranges(latest - _LOOKED_BACK) > _TURNED
        if not turned.any():
            while len(waiting) > _KEPT or (waiting and waiting[0][0] < latest - _LOOKED_BACK):
                waiting.popleft()
            return False
        every = _OFTEN if not self._confirmed or self._tells_mountings(turned) else _SELDOM
        while waiting and waiting[0][0] + _WAIT <= latest:
            stamp, ray = waiting.popleft()
            away = math.hypot(*ray)
            self._range = away if math.isnan(self._range) else self._range
            self._range += _RANGE_SHARE * (away - self._range)
            if stamp - self._judged > every:
                self._judged, judged = stamp, True
                share = self._range / away
                self._score(stamp, (ray[0] * share, ray[1] * share, ray[2] * share), rate)
        return judged

    def _tells_mountings(self, turned: npt.NDArray[np.bool_]) -> bool:
        """Return whether this motion distinguishes the remaining mountings from the right one."""
        differences = _TURNS[np.unique(self._mountings)] - _TURNS[0]
        return bool(differences[..., turned].any())

    def _score(self, stamp: float, ray: Vector3, rate: float) -> None:
        """Score the hypotheses with the bearings that they give to a ray."""
        times = stamp - self._errors
        angles = np.array(self._readings.at_all(np.append(times, (stamp - _SLOPE, stamp + _SLOPE))))
        speeds = np.abs(angles[:, -1] - angles[:, -2]) / (2.0 * _SLOPE)
        angles = angles[:, :-2]
        if self._mountings.any():
            angles = np.einsum("nsa,sn->an", _TURNS[self._mountings], angles)
        x, y, z = self._head.placed(ray, angles[0], angles[1])
        if self._base is not None:
            x, y, z = self._upright(self._base, times, np.array([x, y, z]))
        bearings = np.array([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        self._bank.add(stamp, bearings, speeds, rate)

    def _upright(self, base: HeadBase, times: Array, points: Array) -> Array:
        """Return points in C at times [s], shape (3, N), in the first axes of C."""
        rotations = base.rotations(times)
        if self._first is None:
            self._first = self._head.axes @ base.at(float(times[0])).rotation.inverse()
        points = self._head.axes.inverse().as_matrix() @ points
        square = (rotations * rotations).sum(axis=0)
        half = np.cross(rotations[:3], points, axis=0)
        turned = points + 2.0 / square * (
            rotations[3] * half + np.cross(rotations[:3], half, axis=0)
        )
        return np.asarray(self._first.as_matrix() @ turned)

    def _decide_error(self, scores: Array) -> None:
        """Apply the most likely error if it is significant; remove it if zero is."""
        mean, deviation = self._believed
        applied = float(np.interp(self.applied, _ERRORS, scores))
        farther = abs(mean - self.applied) - _NEARBY
        if abs(mean - self.applied) < _OTHERWISE:
            self._deviation = min(self._deviation, _moments(scores).deviation)
        elif farther > 0.0 and applied > -max(_CONTRADICTED * self._confirmed, _MORE * farther):
            return
        before = self.applied
        if abs(mean) > max(_CLEAR * deviation, _WORTH):
            self.applied = _peak(scores)
        elif self.applied:
            right = np.exp(scores + _PRIOR)
            if right[_ZERO] > _SURE * right.sum() and scores[_ZERO] - applied > _BETTER:
                self.applied = 0.0
        if abs(self.applied - before) >= _OTHERWISE:
            self._deviation = math.inf

    def _decide_mounting(self) -> None:
        """Report a wrong mounting, and exclude those that the points contradict."""
        found = np.unique(self._mountings)
        scores = self._bank.scores
        best = np.array([scores[self._mountings == mounting].max() for mounting in found])
        behind = best[0] - best
        if behind.min() < -_WRONG:
            self.fault = self._named(int(found[behind.argmin()]))
        elif behind.max() > _EXCLUDED:
            kept = np.isin(self._mountings, found[behind < _EXCLUDED])
            self._mountings, self._errors = self._mountings[kept], self._errors[kept]
            self._bank.keep(kept)

    def _named(self, mounting: int) -> str:
        (by_pan, _), (_, by_tilt) = _TURNS[mounting]
        pan, tilt = self._head.pan_joint, self._head.tilt_joint
        if not by_pan:
            return (
                f"{pan} and {tilt} are swapped, as the camera sees it: swap the servos' ids, or "
                "run `servo calibrate` with swapped ids (or is the camera rolled by 90 degrees?)"
            )
        wrong = [joint for joint, way in ((pan, by_pan), (tilt, by_tilt)) if way < 0]
        return (
            f"{' and '.join(wrong)} {'turns' if len(wrong) == 1 else 'turn'} in the wrong "
            "direction, as the camera sees it: find the direction with `servo calibrate` (or is "
            f"the image {'mirrored' if len(wrong) == 1 else 'upside down'}?)"
        )


def _prior() -> Array:
    """Return log probabilities of the errors: most likely none, else Cauchy."""
    others = np.gradient(_ERRORS) / (math.pi * _USUAL * (1.0 + (_ERRORS / _USUAL) ** 2))
    probabilities = (1.0 - _RIGHT) * others
    probabilities[_ZERO] += _RIGHT
    return np.asarray(np.log(probabilities))


_PRIOR = _prior()


def _moments(logarithms: Array) -> StampError:
    """Return mean and standard deviation of the errors by their log probabilities [s]."""
    weights = np.exp(logarithms - logarithms.max())
    weights /= weights.sum()
    mean = float(weights @ _ERRORS)
    return StampError(mean, math.sqrt(float(weights @ (_ERRORS - mean) ** 2)))


def _peak(scores: Array) -> float:
    """Return the error [s] of the best score, interpolated by a parabola."""
    best = int(scores.argmax())
    if not 0 < best < len(scores) - 1:
        return float(_ERRORS[best])
    a, b, c = _ERRORS[best - 1 : best + 2]
    before, here, after = scores[best - 1 : best + 2]
    left, right = (b - a) * (here - after), (b - c) * (here - before)
    if left == right:
        return float(b)
    return float(b - 0.5 * ((b - a) * left - (b - c) * right) / (left - right))
