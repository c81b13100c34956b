"""Multiple-model filter of the two bearings: Kalman filters, weighted by their prediction errors.

`MODELS` lists the models; docs/explain/estimator.md has the equations. Random walk and white
acceleration: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
Navigation, section 6.2.2. A harmonic model of rate 0 is the model of section 6.2.3.

Covariances are divided by the variance of a point, so that the noise density alone decides how a
filter behaves. They depend only on the times of the points and on the rate of the oscillation,
which pan and tilt have in common.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from operator import mul
from typing import Any, NamedTuple, TypeAlias


class Model(NamedTuple):
    """One model of a bearing; a model of order 3 is harmonic.

    Attributes:
        order: number of its states; white noise drives the last one.
        density: spectral density of that noise over the variance of a point [1/s^(2 order - 1)].
        first_score: of a new target, in variances of a point.
        rate: of a harmonic model, while the target does not oscillate [rad/s].
    """

    order: int
    density: float
    first_score: float
    rate: float = 0.0


_USUAL_RATE = 2.0  # rad/s; who moves fast slows down soon

MODELS = (
    Model(1, 1e4, 2.0),  # near-constant position: the latest point
    Model(1, 10.0, 1.0),  # near-constant position, averaged
    Model(2, 1e5, 10.0),  # near-constant velocity, high process noise
    Model(2, 1e4, 3.0),  # near-constant velocity, low process noise
    Model(3, 1e3, 4.0),  # harmonic, low process noise
    Model(3, 5e5, 10.0, _USUAL_RATE),  # harmonic, high process noise
)
"""The first scores favour a target at rest."""

_USUAL_NOISE = 0.003  # rad; noise of a point before it is estimated
_SPEED = 0.5  # rad/s; prior standard deviation of a target's velocity
ACCELERATION = 2.0  # rad/s^2; prior standard deviation of its acceleration
_MEMORY = 2.0  # s; time constant of the scores
_LARGEST_SHARE = 0.04  # largest weight of one point in a score
_ERROR_MEMORY = 0.9  # s; time constant of the errors of the mixture
_NOISE_MEMORY = 2.0  # s; time constant of the variance of the points
_NOISE_POINTS = 6  # fifth differences: a 1 Hz oscillation at 15 points a second vanishes
_OUTLIER = 9.0  # variances
_NEWEST = 0.2  # share of one point in the mean squared error of the newest predictions
_GROWING = 0.1  # share of it in a score, times (lead time / time between points)^2,
_MOST_STEPS = 8.0  # which is at most the square of this
_NONE = (0.0,) * len(MODELS)
_NOISE_OFF = 0.8  # of the variance of a point is subtracted from the scores
_LEAST_SCORE = 0.02  # of that variance
_FINEST = 1e-12  # rad^2; variance of rounding
_WIDEST = 2.0  # rad; largest amplitude of an oscillation that is made smaller
_LEAST_RATE = 1e-3  # rad/s; what is slower is no oscillation

_LAG = 1.0 / 6.0  # s between the points that are compared: observable up to 3 Hz
_LAGS = 0.6, 1.6  # of the lag for the present interval; outside, the fit restarts
_LONGEST = 0.39  # s; longest gap in which a point is interpolated
_RATE_MEMORY = 1.5  # s
_CLEAR = 20.0  # times the noise: least amplitude of an oscillation

State: TypeAlias = tuple[float, float, float]
"""Position [rad], velocity [rad/s] and acceleration [rad/s^2]."""

Transition: TypeAlias = tuple[float, float, float, float]
"""For an oscillation of rate w: sin(w dt)/w, cos(w dt), (1 - cos(w dt))/w^2 and w sin(w dt)."""

Covariance: TypeAlias = tuple[float, float, float, float, float, float]
"""Of a `State`: pp, pv, pa, vv, va, aa; the first three, after a point, are the gains."""


class Course(NamedTuple):
    """The mixed motion of a bearing: a constant acceleration plus an oscillation.

    Attributes:
        position: [rad].
        velocity: of the first part [rad/s].
        acceleration: of the first part [rad/s^2].
        swing_velocity: of the oscillation [rad/s].
        swing_acceleration: of the oscillation [rad/s^2].
        rate: of the oscillation [rad/s].
    """

    position: float
    velocity: float
    acceleration: float
    swing_velocity: float
    swing_acceleration: float
    rate: float

    def within(self, speed: float, acceleration: float) -> Course:
        """Return the motion with an oscillation as large as these limits allow, if it is larger.

        Args:
            speed: highest speed of the oscillation [rad/s].
            acceleration: highest acceleration of the oscillation [rad/s^2].
        """
        position, _, _, u, b, w = self
        peak = math.hypot(u, b / w)
        if (peak <= speed and peak * w <= acceleration) or peak > _WIDEST * w:
            return self
        share = min(speed / peak, acceleration / (peak * w))
        to_centre = b / (w * w)
        return self._replace(
            position=position + (1.0 - share) * to_centre,
            swing_velocity=share * u,
            swing_acceleration=share * b,
        )

    def after(self, dt: float) -> float:
        """Return the position [rad] a time `dt` [s] later."""
        position, velocity, acceleration, u, b, w = self
        swing = (u * math.sin(w * dt) + b * (1.0 - math.cos(w * dt)) / w) / w
        return position + dt * (velocity + 0.5 * dt * acceleration) + swing


class Oscillation(NamedTuple):
    """Estimate of the rate of an oscillation: least squares, corrected for the bias of the noise.

    x(t) - x(t-T) + x(t-2T) - x(t-3T) = 2 cos(wT) (x(t-T) - x(t-2T)) holds for every
    oscillation about any centre; pan and tilt have one rate.

    Attributes:
        squares: of the right difference [rad^2].
        products: of both sides [rad^2].
        rate: w [rad/s]; 0 without an oscillation.
        lag: T [s]; a multiple of the usual time between points.
    """

    squares: float = 0.0
    products: float = 0.0
    rate: float = 0.0
    lag: float = 0.0

    def after(
        self,
        stamps: Sequence[float],
        points: Sequence[Sequence[float]],
        variances: Sequence[float],
    ) -> Oscillation:
        """Return the fit after another point.

        Args:
            stamps: of the points [s], rising; the new one is the last.
            points: pan and tilt of them [rad].
            variances: of a point, in pan and tilt [rad^2].
        """
        if len(stamps) < 5:
            return self
        latest = stamps[-1]
        intervals = sorted(b - a for a, b in pairwise(stamps[-5:]))
        lag = math.ceil(_LAG / intervals[1] - 0.1) * intervals[1]
        if not _LAGS[0] * lag < self.lag < _LAGS[1] * lag:
            return Oscillation(0.0, 0.0, 0.0, lag)
        lag = self.lag
        if stamps[0] > latest - 3.0 * lag:
            return self
        places = [_place(stamps, latest - times * lag) for times in (1.0, 2.0, 3.0)]
        if any(stamps[i + 1] - stamps[i] > _LONGEST for i, _ in places):
            return self
        dt = latest - stamps[-2]
        kept = math.exp(-dt / _RATE_MEMORY)
        squares, products = kept * self.squares, kept * self.products
        noise = sum((1.0 - share) ** 2 + share**2 for _, share in places[:2])
        for angles, variance in zip(points, variances, strict=True):
            b, c, d = (angles[i] + share * (angles[i + 1] - angles[i]) for i, share in places)
            right = b - c
            squares += right * right - noise * variance
            products += right * (angles[-1] - d - right) + noise * variance
        if squares <= _CLEAR * sum(variances) * _RATE_MEMORY / dt:
            return Oscillation(squares, products, 0.0, lag)
        rate = math.acos(min(max(0.5 * products / squares, -1.0), 1.0)) / lag
        return Oscillation(squares, products, rate if rate > _LEAST_RATE else 0.0, lag)


class Bearing(NamedTuple):
    """The state of the filters of one bearing after a point.

    Attributes:
        states: by every model.
        variance: of a point [rad^2].
        scores: mean squared error of every model's predictions over the lead time [rad^2].
        motion: the mixture of the models, by their scores.
        error: mean squared error of the mixture's predictions over the lead time [rad^2].
        far_error: the same over a longer lead time, for points that are overdue.
        certainty: variances of position [rad^2] and velocity [rad^2/s^2] within and between models.
        recent: mean squared error of every model's newest predictions, from point to point [rad^2].
    """

    states: tuple[State, ...]
    variance: float
    scores: tuple[float, ...]
    motion: Course
    error: float
    far_error: float
    certainty: tuple[float, float]
    recent: tuple[float, ...]

    def within(self, limits: tuple[float, float]) -> Bearing:
        """Return the bearing with an oscillation within these limits; see `Course.within`."""
        motion = self.motion.within(*limits)
        return self if motion is self.motion else self._replace(motion=motion)

    def mixed(
        self, covariances: Sequence[Covariance], rate: float, behind: Sequence[float]
    ) -> Bearing:
        """Return the bearing with the mixture of its states by its scores.

        Args:
            covariances: of every model, in variances of a point.
            rate: of the oscillation [rad/s].
            behind: by how much a model's newest predictions are worse than those of the best one,
                as an increase of its score [rad^2].
        """
        variance = self.variance
        off, least = _NOISE_OFF * variance, _LEAST_SCORE * variance
        raw = [
            1.0 / max(score + more - off, least) ** 2
            for score, more in zip(self.scores, behind, strict=True)
        ]
        total = sum(raw)
        weights = [each / total for each in raw]
        origin = self.states[0][0]
        offset = steady = constant = swing = acceleration = 0.0
        for weight, (x, v, a), model in zip(weights, self.states, MODELS, strict=True):
            offset += weight * (x - origin)
            if model.rate or (rate and model.order == 3):
                swing += weight * v
                acceleration += weight * a
            else:
                steady += weight * v
                constant += weight * a
        position, speed = origin + offset, steady + swing
        motion = Course(position, steady, constant, swing, acceleration, rate or _USUAL_RATE)
        square = speeds = 0.0
        for weight, (x, v, _), (pp, _, _, vv, _, _) in zip(
            weights, self.states, covariances, strict=True
        ):
            square += weight * ((x - position) ** 2 + variance * pp)
            speeds += weight * ((v - speed) ** 2 + variance * vv)
        return self._replace(motion=motion, certainty=(square, speeds))


class Bearings(NamedTuple):
    """The state of the filters of pan and tilt after a point.

    Attributes:
        covariances: of every model, of either joint, in variances of a point.
        oscillation: estimate of its rate.
        joints: pan and tilt.
    """

    covariances: tuple[Covariance, ...]
    oscillation: Oscillation
    joints: tuple[Bearing, Bearing]

    @staticmethod
    def seen_once(points: tuple[float, float], leads: tuple[float, float]) -> Bearings:
        """Return the state after the first point of a target.

        Args:
            points: pan and tilt [rad].
            leads: lead time, and the longer one [s].
        """
        variance = _USUAL_NOISE**2
        scores = tuple(variance * model.first_score for model in MODELS)
        still = Course(0.0, 0.0, 0.0, 0.0, 0.0, _USUAL_RATE)
        unknown = Bearing((), variance, scores, still, 0.0, 0.0, (0.0, 0.0), _NONE)
        return Bearings((), Oscillation(), (unknown, unknown)).restarted(points, leads)

    def restarted(self, points: tuple[float, float], leads: tuple[float, float]) -> Bearings:
        """Return the state after a jump to `points` [rad]; its velocity is not known.

        The noise of the points, the rate of the oscillation and the scores of the models are kept.
        """
        pan, tilt = self.joints
        variance = 0.5 * (pan.variance + tilt.variance)
        priors = (_SPEED**2 / variance, ACCELERATION**2 / variance)
        covariances = tuple(
            (
                1.0,
                0.0,
                0.0,
                priors[0] if model.order > 1 else 0.0,
                0.0,
                priors[1] if model.order > 2 else 0.0,
            )
            for model in MODELS
        )
        joints = []
        for bearing, point in zip(self.joints, points, strict=True):
            least, far_least = (bearing.variance + (_SPEED * lead) ** 2 for lead in leads)
            started = bearing._replace(
                states=((point, 0.0, 0.0),) * len(MODELS),
                error=max(bearing.error, least),
                far_error=max(bearing.far_error, far_least),
                recent=_NONE,
            )
            joints.append(started.mixed(covariances, self.oscillation.rate, _NONE))
        return Bearings(covariances, self.oscillation, (joints[0], joints[1]))

    def after(
        self,
        stamps: Sequence[float],
        points: tuple[Sequence[float], Sequence[float]],
        judged: Sequence[tuple[Bearings, float]],
        *,
        is_unsure: bool = False,
    ) -> Bearings:
        """Return the state after another point.

        Args:
            stamps: of the points [s], rising; the new one is the last.
            points: pan and tilt of them [rad].
            judged: the states after two earlier points, and the times from these to now [s]: about
                the lead times. The predictions made then are judged now.
            is_unsure: the models are not weighted by their newest predictions.
        """
        dt = stamps[-1] - stamps[-2]
        variances = self._noise(stamps, points)
        oscillation = self.oscillation.after(stamps, points, variances)
        rate = oscillation.rate
        swings = _transitions(dt, rate)
        (near, ahead), (far, far_ahead) = judged
        ahead_swings = _transitions(ahead, rate)
        covariances = tuple(
            _corrected(model, covariance, dt, swing)
            for model, covariance, swing in zip(MODELS, self.covariances, swings, strict=True)
        )
        share = min(1.0 - math.exp(-dt / _MEMORY), _LARGEST_SHARE)
        error_share = 1.0 - math.exp(-dt / min(stamps[-1] - stamps[0], _ERROR_MEMORY))
        growth = 0.0 if is_unsure else _GROWING * min(ahead / dt, _MOST_STEPS) ** 2
        joints = []
        for bearing, before, long_before, angles, variance in zip(
            self.joints, near.joints, far.joints, points, variances, strict=True
        ):
            point = angles[-1]
            moved = _moved(bearing.states, swings)
            recent = tuple(
                [
                    error + _NEWEST * ((x - point) ** 2 - error)
                    for error, (x, _, _) in zip(bearing.recent, moved, strict=True)
                ]
            )
            best = min(recent)
            behind = [growth * (error - best) for error in recent]
            states = tuple(
                [
                    (x + k * (point - x), v + kv * (point - x), a + ka * (point - x))
                    for (x, v, a), (k, kv, ka, _, _, _) in zip(moved, covariances, strict=True)
                ]
            )
            scores = tuple(
                [
                    score + share * ((x - point) ** 2 - score) + _FINEST
                    for score, (x, _, _) in zip(
                        bearing.scores, _moved(before.states, ahead_swings), strict=True
                    )
                ]
            )
            missed = before.motion.after(ahead) - point
            far_missed = long_before.motion.after(far_ahead) - point
            after = bearing._replace(
                states=states,
                variance=variance,
                scores=scores,
                error=bearing.error + error_share * (missed * missed - bearing.error),
                far_error=bearing.far_error
                + error_share * (far_missed * far_missed - bearing.far_error),
                recent=recent,
            )
            joints.append(after.mixed(covariances, rate, behind))
        return Bearings(covariances, oscillation, (joints[0], joints[1]))

    def _noise(self, stamps: Sequence[float], points: Sequence[Sequence[float]]) -> list[float]:
        """Return the variances of a point, from differences in which smooth motion vanishes."""
        if len(stamps) < _NOISE_POINTS:
            return [bearing.variance for bearing in self.joints]
        last = stamps[-_NOISE_POINTS:]
        factors = [1.0 / math.prod([a - b for b in last if b is not a]) for a in last]
        scale = math.hypot(*factors)
        share = 1.0 - math.exp((stamps[-2] - stamps[-1]) / _NOISE_MEMORY)
        learned = []
        for bearing, angles in zip(self.joints, points, strict=True):
            difference = sum(map(mul, factors, angles[-_NOISE_POINTS:])) / scale
            square = min(difference * difference, _OUTLIER * bearing.variance)
            learned.append(bearing.variance + share * (square - bearing.variance) + _FINEST)
        return learned


def transition(dt: float, rate: float) -> Transition:
    """Return the transition of a harmonic model over a time `dt` [s]; rate 0: no oscillation."""
    if not rate:
        return dt, 1.0, 0.5 * dt * dt, 0.0
    sine, cosine = math.sin(rate * dt), math.cos(rate * dt)
    return sine / rate, cosine, (1.0 - cosine) / (rate * rate), rate * sine


def _corrected(model: Model, covariance: Covariance, dt: float, swing: Transition) -> Covariance:
    """Return the covariance after a point, a time `dt` [s] later."""
    pp, pv, pa, vv, va, aa = covariance
    q = model.density
    if model.order == 1:
        pp += q * dt
        return pp / (pp + 1.0), 0.0, 0.0, 0.0, 0.0, 0.0
    d2, d3 = dt * dt, dt * dt * dt
    if model.order == 2:
        pp += dt * (2.0 * pv + dt * vv) + q * d3 / 3.0
        pv += dt * vv + 0.5 * q * d2
        vv += q * dt
        k, kv = pp / (pp + 1.0), pv / (pp + 1.0)
        return k, kv, 0.0, vv - kv * pv, 0.0, 0.0
    qd2, qd3 = q * d2, q * d3
    noise = qd3 * d2 / 20.0, qd2 * d2 / 8.0, qd3 / 6.0, qd3 / 3.0, qd2 / 2.0, q * dt
    pp, pv, pa, vv, va, aa = moved_covariance(covariance, swing, noise)
    k, kv, ka = pp / (pp + 1.0), pv / (pp + 1.0), pa / (pp + 1.0)
    return k, kv, ka, vv - kv * pv, va - kv * pa, aa - ka * pa


def moved_covariance(
    covariance: Sequence[Any], swing: Sequence[Any], noise: Sequence[Any]
) -> tuple[Any, ...]:
    """Return the covariance of a harmonic model later: F P F' + Q, in numbers or arrays.

    Args:
        covariance: P, as `Covariance`.
        swing: F, as `Transition`: its rows are (1, s, r), (0, c, s) and (0, -b, c).
        noise: Q, as `Covariance`.
    """
    pp, pv, pa, vv, va, aa = covariance
    s, c, r, b = swing
    f_pp, f_pv, f_pa = pp + s * pv + r * pa, pv + s * vv + r * va, pa + s * va + r * aa
    f_vv, f_va = c * vv + s * va, c * va + s * aa
    f_av, f_aa = c * va - b * vv, c * aa - b * va
    return (
        f_pp + s * f_pv + r * f_pa + noise[0],
        c * f_pv + s * f_pa + noise[1],
        c * f_pa - b * f_pv + noise[2],
        c * f_vv + s * f_va + noise[3],
        c * f_va - b * f_vv + noise[4],
        c * f_aa - b * f_av + noise[5],
    )


def _transitions(dt: float, rate: float) -> list[Transition]:
    """Return the transition of every model over a time `dt` [s]."""
    steady = transition(dt, 0.0)
    return [transition(dt, rate or model.rate) if model.order == 3 else steady for model in MODELS]


def _moved(states: Sequence[State], swings: Sequence[Transition]) -> list[State]:
    """Return the states of the models later; a state that a model does not have is 0."""
    return [
        (x + s * v + r * a, c * v + s * a, c * a - b * v)
        for (x, v, a), (s, c, r, b) in zip(states, swings, strict=True)
    ]


def _place(stamps: Sequence[float], time: float) -> tuple[int, float]:
    """Return the index of the point before a time, and the elapsed part of its interval."""
    before = bisect_right(stamps, time) - 1
    return before, (time - stamps[before]) / (stamps[before + 1] - stamps[before])
