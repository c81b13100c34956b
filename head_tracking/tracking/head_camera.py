"""Estimate the stamp error of a camera on the head, and detect wrongly mounted servos.

A point of such a camera is a ray. Its bearing follows from the joint positions at the time of the
image. Each hypothesis (a stamp error, a mounting of the servos) gives another bearing. Only under
the true hypothesis does the target move smoothly while the head turns.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking.hypothesis_bank import HypothesisBank
from head_tracking.tracking.joint_readings import JointReadings
from head_tracking.tracking.learned import KNOWN, LearnedValue, Learning, LearningParameters
from head_tracking.tracking.target import HeadBase
from head_tracking.transforms import Rotation, Vector3

Array = npt.NDArray[np.float64]

_ERRORS: Array = np.arange(-0.2, 0.901, 0.02)
"""Hypotheses of the stamp error [s]."""
_RIGHT = 0.3  # prior probability that the applied error is right
_USUAL = 0.1  # s; scale of the Cauchy prior of the distance to another error
_LEAST_DEVIATION = 0.006  # s; limit set by the target's own motion
_WORTH = 0.025  # s; smaller errors are not corrected,
_CLEAR = 4.0  # nor errors below this number of deviations
_EXACT = 0.03  # s; a correction with a smaller deviation is confirmed
_NEGLIGIBLE = 0.001  # a point is not placed with a less probable error

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
_WRONG = 10.0  # a wrong mounting whose score is better by this is reported,
_AWAY = 0.15  # rad; if one of its joints has turned by this: it runs away from the target
_EXCLUDED = 10.0  # a wrong mounting whose score is worse by this is excluded

_OTHERWISE = 0.02  # s; a larger change of the correction restarts the target estimator
_OFTEN, _SELDOM = 0.015, 0.12  # s between scored points: usually; once the error is confirmed
_LOOKED_BACK = 1.2  # s; points are scored if a joint
_TURNED = 0.02  # rad; has turned by this in that time
_KEPT = 8  # points that are kept from before the head turns
_RECENT, _MOST_RECENT = 1.0, 64  # s and points that are corrected again
_INTERRUPTED = 1.5  # s without points; the camera may have restarted, with another delay
_AHEAD = 1.0  # s; points stamped later than this after the latest reading are not scored
_SLOPE = 0.03  # s before and after a stamp, for the speed of a joint
_RANGE_SHARE = 0.2  # weight of a measured distance in the mean distance


class HeadCamera:
    """Estimate the stamp error of a camera on the head and the mounting of its servos.

    Times are in seconds on the clock of the stamps.

    Args:
        head: the head that carries the camera.
        readings: readings of its joints.
        base: pose of the head's base frame; None: it does not move.

    Attributes:
        parameters: whether points are scored; the stamp error that is given instead.
        fault: description of a wrong mounting; empty: none was found.
        waiting: rays to be scored: stamp [s] and point in camera axes [m].
        is_unsure: whether the last point lies at the mean over the possible errors.
    """

    def __init__(
        self, head: PanTiltHead, readings: JointReadings, base: HeadBase | None = None
    ) -> None:
        self.parameters = LearningParameters()
        self._head, self._readings, self._base = head, readings, base
        self.forget()

    def forget(self) -> None:
        """Discard the points and the estimates."""
        self.fault, self.is_unsure = "", False
        self.waiting: deque[tuple[float, Vector3]] = deque()
        self._came = self._judged = -math.inf
        self._range = math.nan
        self._rate = self._applied = self._placed_for = 0.0
        self._first: Rotation | None = None
        self._deviation = math.inf  # of the applied error, when the points told it best
        self._recent: deque[tuple[float, Vector3]] = deque(maxlen=_MOST_RECENT)
        wrong = len(_TURNS) - 1
        counts = [len(_ERRORS)] + wrong * [len(_NEAR)]
        self._hypothesize(
            np.concatenate([_ERRORS, np.tile(_NEAR, wrong)]),
            np.repeat(np.arange(len(_TURNS)), counts),
        )
        self._bank = HypothesisBank(len(self._errors), self._mountings > 0)
        self._probabilities = _probabilities(self._prior)

    @property
    def applied(self) -> float:
        """The stamp error that is corrected [s]."""
        given = self.parameters
        return given.camera_delay if given.has_camera_delay else self._applied

    @property
    def _is_learning(self) -> bool:
        return self.parameters.camera_learning != Learning.FREEZE

    @property
    def learned(self) -> LearnedValue:
        """The corrected stamp error."""
        mean, alone = _moments(_probabilities(self._timing))  # by the points, without the prior
        deviation = min(self._deviation, math.hypot(alone, mean - self.applied))
        return LearnedValue(
            self.applied,
            "s",
            max(deviation, _LEAST_DEVIATION),
            self._judged,
            KNOWN,
            is_given=self.parameters.has_camera_delay,
            is_frozen=not self._is_learning,
        )

    @property
    def _timing(self) -> Array:
        """Scores of the stamp errors with the right mounting."""
        return self._bank.scores[: len(_ERRORS)]

    @property
    def _prior(self) -> Array:
        return np.asarray(_PRIORS[np.abs(_ERRORS - self.applied).argmin()])

    def corrected(self, stamp: float, point: Vector3) -> tuple[float, Vector3]:
        """Accept a point; return its corrected stamp [s] and position [m].

        While the stamp error is uncertain, the position is the mean over the possible errors.

        Args:
            stamp: stamp of the point [s].
            point: shape (3,) [m], in the fixed frame, transformed with the joints at `stamp`.
        """
        pan, tilt = self._readings.at(stamp)
        in_base = point if self._base is None else self._base.at(stamp).inverse() @ point
        ray = self._head.seen(in_base, pan, tilt)
        latest = self._readings.latest
        if latest is not None and self._came < stamp < latest.stamp + _AHEAD:
            if stamp - self._came > _INTERRUPTED:
                self._bank.doubt()
            self._came = stamp
            self._recent.append((stamp, ray))
            if self._is_learning:
                self.waiting.append((stamp, ray))
                self._judge()
        estimated = self._is_learning and not self.parameters.has_camera_delay
        self.is_unsure = estimated and self._is_uncertain and bool(self._turned().any())
        if self.is_unsure:
            return stamp - self.applied, self._mean_place(stamp, ray)
        return self._placed(stamp, ray) if self.applied else (stamp, point)

    @property
    def _is_uncertain(self) -> bool:
        mean, deviation = _moments(self._probabilities)
        return math.hypot(deviation, mean - self.applied) > _WORTH

    def _turned(self, angle: float = _TURNED) -> npt.NDArray[np.bool_]:
        """Return whether pan and tilt have turned by an angle [rad] within the possible errors."""
        return self._readings.ranges(_LOOKED_BACK) > angle

    def _mean_place(self, stamp: float, ray: Vector3) -> Vector3:
        """Return the mean of the points of a ray in the fixed frame [m] over the stamp errors."""
        likely = self._probabilities > _NEGLIGIBLE
        places = [self._place(stamp - error, ray) for error in _ERRORS[likely].tolist()]
        x, y, z = np.average(places, axis=0, weights=self._probabilities[likely]).tolist()
        return x, y, z

    def _place(self, taken: float, ray: Vector3) -> Vector3:
        """Return the point of a ray in the fixed frame [m], seen at a time [s]."""
        pan, tilt = self._readings.at(taken)
        point = self._head.placed_in_base(ray, pan, tilt)
        return point if self._base is None else self._base.at(taken) @ point

    def restart(self) -> None:
        """Discard the points, and the estimates unless they are frozen, after a clock's jump."""
        applied, deviation = self.applied, self._deviation
        self.forget()
        if not self._is_learning:
            self._applied = self._placed_for = applied
            self._deviation = deviation

    def forget_target(self) -> None:
        """Discard the points of the target, and keep the estimates."""
        self._recent.clear()

    def _placed(self, stamp: float, ray: Vector3) -> tuple[float, Vector3]:
        """Return the corrected stamp of a ray [s] and its point in the fixed frame [m]."""
        taken = stamp - self.applied
        return taken, self._place(taken, ray)

    def update(self, rate: float) -> list[tuple[float, Vector3]]:
        """Score the points whose joint readings are complete.

        Args:
            rate: of the target's oscillation [rad/s]; 0: none is known.

        Returns:
            If the correction has changed by more than 20 ms, the points of the last second with
            the new correction: stamps [s] and points in the fixed frame [m].
        """
        self._rate = rate
        self._judge()
        latest, before = self._readings.latest, self._placed_for
        self._placed_for = self.applied
        if latest is None or abs(self.applied - before) < _OTHERWISE:
            return []
        return [self._placed(*ray) for ray in self._recent if ray[0] > latest.stamp - _RECENT]

    def _judge(self) -> None:
        """Score the rays whose joint readings have come, and decide."""
        if self._score_waiting():
            self._probabilities = _probabilities(self._timing + self._prior)
            self._decide_error()
            self._decide_mounting()

    def _score_waiting(self) -> bool:
        """Score the rays whose joint readings have come; return whether there were any.

        While the head does not move, the hypotheses do not differ, and rays are only kept.
        """
        waiting, judged = self.waiting, False
        latest = -math.inf if self._readings.latest is None else self._readings.latest.stamp
        if not waiting or waiting[0][0] > latest:
            return False
        turned = self._turned()
        if not turned.any():
            while len(waiting) > _KEPT or (waiting and waiting[0][0] < latest - _LOOKED_BACK):
                waiting.popleft()
            return False
        is_confirmed = self._bank.explains and self._deviation < _EXACT
        every = _OFTEN if not is_confirmed or self._tells_mountings(turned) else _SELDOM
        while waiting and waiting[0][0] <= latest:
            stamp, ray = waiting.popleft()
            away = math.hypot(*ray)
            self._range = away if math.isnan(self._range) else self._range
            self._range += _RANGE_SHARE * (away - self._range)
            if stamp - self._judged > every:
                self._judged, judged = stamp, True
                share = self._range / away
                self._score(stamp, (ray[0] * share, ray[1] * share, ray[2] * share))
        return judged

    def _hypothesize(self, errors: Array, mountings: npt.NDArray[np.intp]) -> None:
        """Set the hypotheses: their stamp errors [s], and mountings as indices of `_TURNS`."""
        self._errors, self._mountings = errors, mountings
        self._starts = np.flatnonzero(np.diff(mountings, prepend=-1))  # of each mounting
        self._differences = _TURNS[mountings[self._starts]] - _TURNS[0]

    def _tells_mountings(self, turned: npt.NDArray[np.bool_]) -> bool:
        """Return whether this motion distinguishes the remaining mountings from the right one."""
        return bool(self._differences[..., turned].any())

    def _score(self, stamp: float, ray: Vector3) -> None:
        """Score the hypotheses with the bearings that they give to a ray."""
        times = stamp - self._errors
        angles = np.array(self._readings.at_all(np.append(times, (stamp - _SLOPE, stamp + _SLOPE))))
        speeds = np.abs(angles[:, -1] - angles[:, -2]) / (2.0 * _SLOPE)
        angles = angles[:, :-2]
        if self._mountings[-1]:
            angles = np.einsum("nsa,sn->an", _TURNS[self._mountings], angles)
        x, y, z = self._head.placed(ray, angles[0], angles[1])
        if self._base is not None:
            x, y, z = self._upright(self._base, times, np.array([x, y, z]))
        bearings = np.array([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        self._bank.add(stamp, bearings, speeds, self._rate)

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

    def _decide_error(self) -> None:
        """Apply another error if it is significant; else improve the applied one."""
        mean, deviation = _moments(self._probabilities)
        _, alone = _moments(_probabilities(self._timing))
        change = abs(mean - self.applied)
        is_other = change > max(_CLEAR * deviation, _WORTH)
        if is_other:
            self._deviation = alone
        elif change < _OTHERWISE and alone < _EXACT:
            self._deviation = min(self._deviation, alone)
        else:
            return
        if is_other or self.applied:
            found = _peak(self._timing)
            self._applied = found if abs(found) > _WORTH else 0.0

    def _decide_mounting(self) -> None:
        """Report a wrong mounting, and exclude those that the points contradict."""
        if not self._mountings[-1]:
            return  # all are excluded
        found = self._mountings[self._starts]
        best = np.maximum.reduceat(self._bank.scores, self._starts)
        behind = best[0] - best
        if behind.min() < -_WRONG:
            if self._differences[behind.argmin()][..., self._turned(_AWAY)].any():
                self.fault = self._named(int(found[behind.argmin()]))
        elif behind.max() > _EXCLUDED:
            kept = np.isin(self._mountings, found[behind < _EXCLUDED])
            self._hypothesize(self._errors[kept], self._mountings[kept])
            self._bank.keep(kept)

    def _named(self, mounting: int) -> str:
        (by_pan, _), (_, by_tilt) = _TURNS[mounting]
        pan, tilt = self._head.pan_joint, self._head.tilt_joint
        if not by_pan:
            return (
                f"{pan} and {tilt} are swapped, as the camera sees it: swap the servos' ids, or "
                "run `head_tracking servo calibrate` with swapped ids (or is the camera rolled by "
                "90 degrees?)"
            )
        wrong = [joint for joint, way in ((pan, by_pan), (tilt, by_tilt)) if way < 0]
        return (
            f"{' and '.join(wrong)} {'turns' if len(wrong) == 1 else 'turn'} in the wrong "
            "direction, as the camera sees it: find the direction with `head_tracking servo "
            f"calibrate` (or is the image {'mirrored' if len(wrong) == 1 else 'upside down'}?)"
        )


def _prior(usual: float) -> Array:
    """Return log probabilities of the errors: most likely the usual one, else Cauchy."""
    off = (_ERRORS - usual) / _USUAL
    others = np.gradient(_ERRORS) / (math.pi * _USUAL * (1.0 + off * off))
    probabilities = (1.0 - _RIGHT) * others
    probabilities[np.abs(off).argmin()] += _RIGHT
    return np.asarray(np.log(probabilities))


_PRIORS: Array = np.array([_prior(error) for error in _ERRORS])


def _probabilities(logarithms: Array) -> Array:
    weights = np.exp(logarithms - logarithms.max())
    return np.asarray(weights / weights.sum())


def _moments(probabilities: Array) -> tuple[float, float]:
    """Return mean and standard deviation of the errors [s]."""
    mean = float(probabilities @ _ERRORS)
    return mean, math.sqrt(float(probabilities @ (_ERRORS - mean) ** 2))


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
