"""A multiple-model filter of one bearing: six Kalman filters, mixed by how well each predicts.

The models (docs/estimator.md has the equations): a target that stands still but for a random walk;
two of nearly constant velocity, calm and restless (white acceleration: Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, section 6.2.2); and two
harmonic oscillators about any centre, calm and lively (white jerk), whose rate is learned from the
points. An oscillator of rate 0 is the model of nearly constant acceleration (section 6.2.3).

Covariances are in units of the variance of a point, so that one number decides how a filter
behaves: its tracking index, the spectral density of the disturbance over that variance.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

STILL = 10.0
"""Random walk of the still model [1/s]."""

CALM, WALKING, RESTLESS = 3e1, 1e3, 3e5
"""White acceleration of the models of nearly constant velocity [1/s^3]; the one that walks takes
the target to go straight on, so that its bearing turns faster the nearer it comes."""

OSCILLATORS = (1e3, 5e6)
"""White jerk of the two harmonic oscillators [1/s^5]."""

# What is known of a target seen once, in units of a point's variance. Bearings of 2 mrad make this
# 2 rad/s and 2 rad/s^2: more would let the second point throw the head.
_UNKNOWN = 1e6

# A new target is expected to be calm until it shows that it is not.
_FIRST_SCORES = (1.0, 2.0, 3.0, 10.0, 4.0, 10.0)

_MEMORY = 0.5  # s; over which the models are judged
_ERROR_MEMORY = 0.9  # s; over which the mixture is judged: a kink now and then is remembered
_SHARPNESS = 2  # how strongly the better model wins
_NOISE_OFF = 0.8  # of the noise of a point, which no model can predict, is taken off the scores
_LEAST_SCORE = 0.02  # of that noise
_FINEST = 1e-12  # rad^2; noise below this is rounding
_OUTLIER = 9.0  # variances
_ALARM = 0.15  # s; how long a model stays doubted
_DEVIATIONS = 3.0
_NO_ALARM = 0.01
_NEAREST = 0.3  # of the distance; so near a walker is taken to come
_LEAST_SHARE = 1e-9  # of the models
_LEAST_RATE = 1e-3  # rad/s; below it an oscillation is a constant acceleration

_LAG = 1.0 / 6.0  # s between the points that are compared: swings up to 3 Hz can be told
_RATE_MEMORY = 1.5  # s
_CLEAR = 20.0  # times the noise; a swing must stand out like this

Covariance2: TypeAlias = tuple[float, float, float]
"""Of position and velocity: pp, pv, vv."""

Covariance3: TypeAlias = tuple[float, float, float, float, float, float]
"""Of position, velocity and acceleration: pp, pv, pa, vv, va, aa."""

Six: TypeAlias = tuple[float, float, float, float, float, float]
"""One number for every model."""


_CALM_MODELS: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Motion(NamedTuple):
    """How a bearing moves: by a walk along a straight line, a steady turn and a swing.

    Attributes:
        position: [rad].
        walk: velocity of a target that walks straight on [rad/s].
        share: of all models, those that say so; `walk` is this share of its velocity.
        receding: change of the logarithm of the distance [1/s].
        velocity: of the steady part [rad/s].
        swing_velocity: of the swinging part [rad/s].
        swing_acceleration: of the swinging part [rad/s^2].
        rate: at which that part swings [rad/s].
    """

    position: float
    walk: float
    share: float
    receding: float
    velocity: float
    swing_velocity: float
    swing_acceleration: float
    rate: float

    def after(self, dt: float) -> tuple[float, float]:
        """Position [rad] and velocity [rad/s] a time `dt` [s] later."""
        x, walk, share, receding, v, u, b, w = self
        sine, cosine = math.sin(w * dt), math.cos(w * dt)
        turned, slowed = walked(walk / share, receding, dt)
        position = x + share * turned + dt * v + (u * sine + b * (1.0 - cosine) / w) / w
        return position, slowed * walk + v + u * cosine + b * sine / w


def walked(velocity: float, receding: float, dt: float) -> tuple[float, float]:
    """How far a bearing turns in a time `dt` [s] if the target walks straight on.

    As seen from where the target was, it has gone aside and away (Aidala and Hammel, modified polar
    coordinates, 1983).

    Args:
        velocity: of the bearing [rad/s].
        receding: change of the logarithm of the distance [1/s].
        dt: [s].

    Returns:
        The angle [rad], and what is left of the velocity as a share of it.
    """
    aside, away = velocity * dt, max(1.0 + receding * dt, _NEAREST)
    return math.atan2(aside, away), 1.0 / (away * away + aside * aside)


class Gains(NamedTuple):
    """Variances and gains of the models whose gains depend on the times of the points alone.

    Attributes:
        still: of the still model: its variance after the point, which is its gain.
        calm, walking, restless: of the models of nearly constant velocity, after the point.
        expected: variances of the four predictions, point's noise included.
    """

    still: float
    calm: Covariance2
    walking: Covariance2
    restless: Covariance2
    expected: tuple[float, float, float, float]

    @staticmethod
    def seen_once() -> Gains:
        """Of a target of which one point is known."""
        once = (1.0, 0.0, _UNKNOWN)
        return Gains(1.0, once, once, once, (1.0, 1.0, 1.0, 1.0))

    def after(self, dt: float) -> Gains:
        """Those of the next point, a time `dt` [s] later."""
        walk = self.still + STILL * dt
        calm, by_calm = _corrected(self.calm, dt, CALM)
        walking, by_walking = _corrected(self.walking, dt, WALKING)
        restless, by_restless = _corrected(self.restless, dt, RESTLESS)
        expected = (walk + 1.0, by_calm, by_walking, by_restless)
        return Gains(walk / (walk + 1.0), calm, walking, restless, expected)


class Oscillation(NamedTuple):
    """What is known of the rate of a swing: a fit by least squares, freed of the noise's bias.

    x(t) - x(t-T) + x(t-2T) - x(t-3T) = 2 cos(wT) (x(t-T) - x(t-2T)) holds for every swing about
    any centre.

    Attributes:
        squares: of the right difference [rad^2].
        products: of both sides [rad^2].
        rate: w [rad/s]; 0 where no swing is seen.
    """

    squares: float
    products: float
    rate: float

    def after(
        self, stamps: Sequence[float], points: Sequence[float], variance: float
    ) -> Oscillation:
        """The fit after another point; stamps [s] rise and end with its own."""
        newest = stamps[-1]
        if len(stamps) < 5 or stamps[0] > newest - 3.0 * _LAG:
            return self
        a = points[-1]
        b, noise_b = _between(stamps, points, newest - _LAG)
        c, noise_c = _between(stamps, points, newest - 2.0 * _LAG)
        d, _ = _between(stamps, points, newest - 3.0 * _LAG)
        left, right = a - b + c - d, b - c
        bias = (noise_b + noise_c) * variance
        dt = newest - stamps[-2]
        kept = math.exp(-dt / _RATE_MEMORY)
        squares = kept * self.squares + right * right - bias
        products = kept * self.products + right * left + bias
        if squares <= _CLEAR * variance * _RATE_MEMORY / dt:
            return Oscillation(squares, products, 0.0)
        cosine = min(max(0.5 * products / squares, -1.0), 1.0)
        return Oscillation(squares, products, math.acos(cosine) / _LAG)


class Oscillator(NamedTuple):
    """One harmonic model after a point [rad, s]."""

    position: float
    velocity: float
    acceleration: float
    covariance: Covariance3


class Bearing(NamedTuple):
    """All that is known of one bearing after a point.

    Attributes:
        still: position by the still model [rad].
        calm, walking, restless: position [rad] and velocity [rad/s] by the models of constant
            velocity.
        oscillators: the harmonic models.
        oscillation: the rate of the swing.
        variance: of a point [rad^2].
        scores: mean squared error of each model's predictions [rad^2].
        innovations: of each model at the point, in standard deviations.
        alarm: how strongly each model is to be doubted.
        weights: of the models; they add up to 1.
        motion: the mixture.
        error: mean squared error of the mixture's predictions [rad^2].
        certainty: variance of position and of velocity by the models' own account [rad^2].
    """

    still: float
    calm: tuple[float, float]
    walking: tuple[float, float]
    restless: tuple[float, float]
    oscillators: tuple[Oscillator, Oscillator]
    oscillation: Oscillation
    variance: float
    scores: Six
    innovations: Six
    alarm: Six
    weights: Six
    motion: Motion
    error: float
    certainty: tuple[float, float]

    @staticmethod
    def seen_once(point: float, noise: float, gains: Gains) -> Bearing:
        """A target of which one point is known [rad], with the usual noise of points [rad]."""
        variance = noise * noise
        first = Oscillator(point, 0.0, 0.0, (1.0, 0.0, 0.0, _UNKNOWN, 0.0, _UNKNOWN))
        scores = _six([variance * factor for factor in _FIRST_SCORES])
        calm = _CALM_MODELS
        return _mixed(
            gains,
            0.0,
            Bearing(
                point,
                (point, 0.0),
                (point, 0.0),
                (point, 0.0),
                (first, first),
                Oscillation(0.0, 0.0, 0.0),
                variance,
                scores,
                calm,
                calm,
                _weights(scores, calm, variance),
                Motion(point, 0.0, _LEAST_SHARE, 0.0, 0.0, 0.0, 0.0, _LEAST_RATE),
                variance,
                (0.0, 0.0),
            ),
        )

    def predicted(self, dt: float, rate: float) -> Six:
        """The position by every model [rad] a time `dt` [s] later; swings have this rate."""
        by_velocity, by_acceleration = dt, 0.5 * dt * dt
        if rate > _LEAST_RATE:
            by_velocity = math.sin(rate * dt) / rate
            by_acceleration = (1.0 - math.cos(rate * dt)) / (rate * rate)
        calm, lively = self.oscillators
        return (
            self.still,
            self.calm[0] + dt * self.calm[1],
            self.walking[0] + walked(self.walking[1], self.motion.receding, dt)[0],
            self.restless[0] + dt * self.restless[1],
            calm.position + by_velocity * calm.velocity + by_acceleration * calm.acceleration,
            lively.position + by_velocity * lively.velocity + by_acceleration * lively.acceleration,
        )

    def after(
        self,
        stamps: Sequence[float],
        points: Sequence[float],
        gains: Gains,
        receding: float,
        judged: Bearing,
        ahead: float,
    ) -> Bearing:
        """The bearing after another point.

        Args:
            stamps: of the points [s], rising; the new one is the last.
            points: [rad].
            gains: for it.
            receding: change of the logarithm of the distance [1/s].
            judged: the bearing after an earlier point, whose predictions are judged now.
            ahead: the time from then until now [s].
        """
        point, dt = points[-1], stamps[-1] - stamps[-2]
        oscillation = self.oscillation.after(stamps, points, self.variance)
        off = point - self.still
        still = self.still + gains.still * off
        calm, off_calm = _corrected_by(
            (self.calm[0] + dt * self.calm[1], self.calm[1]), gains.calm, point
        )
        turned, slowed = walked(self.walking[1], receding, dt)
        walking, off_walking = _corrected_by(
            (self.walking[0] + turned, slowed * self.walking[1]), gains.walking, point
        )
        restless, off_restless = _corrected_by(
            (self.restless[0] + dt * self.restless[1], self.restless[1]), gains.restless, point
        )
        swing = _Swing.over(dt, oscillation.rate)
        one, innovation_one = swing.corrected(self.oscillators[0], OSCILLATORS[0], point)
        two, innovation_two = swing.corrected(self.oscillators[1], OSCILLATORS[1], point)
        by_still, by_calm, by_walking, by_restless = gains.expected
        deviation = math.sqrt(self.variance)
        innovation_restless = off_restless / math.sqrt(by_restless)
        innovations = (
            off / (deviation * math.sqrt(by_still)),
            off_calm / (deviation * math.sqrt(by_calm)),
            off_walking / (deviation * math.sqrt(by_walking)),
            innovation_restless / deviation,
            innovation_one / deviation,
            innovation_two / deviation,
        )
        share = 1.0 - math.exp(-dt / _MEMORY)
        scores = _six(
            [
                score + share * ((position - point) ** 2 - score) + _FINEST
                for score, position in zip(
                    self.scores, judged.predicted(ahead, oscillation.rate), strict=True
                )
            ]
        )
        noise = min(innovation_restless * innovation_restless, _OUTLIER * self.variance)
        variance = self.variance + share * (noise - self.variance) + _FINEST
        missed = judged.motion.after(ahead)[0] - point
        error = self.error + (1.0 - math.exp(-dt / _ERROR_MEMORY)) * (missed * missed - self.error)
        alarm = _alarmed(self, innovations, math.exp(-dt / _ALARM))
        return _mixed(
            gains,
            receding,
            Bearing(
                still,
                calm,
                walking,
                restless,
                (one, two),
                oscillation,
                variance,
                scores,
                innovations,
                alarm,
                _weights(scores, alarm, variance),
                self.motion,
                error,
                self.certainty,
            ),
        )


class _Swing(NamedTuple):
    """The transition of a harmonic oscillator over a time, and white jerk of density 1 in it."""

    sine: float  # sin(w dt) / w
    cosine: float
    versine: float  # (1 - cos(w dt)) / w^2
    back: float  # w sin(w dt)
    jerk: Covariance3

    @staticmethod
    def over(dt: float, rate: float) -> _Swing:
        d2, d3 = dt * dt, dt * dt * dt
        jerk = (d3 * d2 / 20.0, d2 * d2 / 8.0, d3 / 6.0, d3 / 3.0, d2 / 2.0, dt)
        if rate <= _LEAST_RATE:
            return _Swing(dt, 1.0, 0.5 * d2, 0.0, jerk)
        sine, cosine = math.sin(rate * dt), math.cos(rate * dt)
        return _Swing(sine / rate, cosine, (1.0 - cosine) / (rate * rate), rate * sine, jerk)

    def corrected(self, model: Oscillator, index: float, point: float) -> tuple[Oscillator, float]:
        """The model after a point, and its innovation over the expected deviation."""
        x, v, a, (pp, pv, pa, vv, va, aa) = model
        s, c, r, b, jerk = self
        x, v, a = x + s * v + r * a, c * v + s * a, c * a - b * v
        # F P, where its rows are (1, s, r), (0, c, s) and (0, -b, c)
        f_pp, f_pv, f_pa = pp + s * pv + r * pa, pv + s * vv + r * va, pa + s * va + r * aa
        f_vv, f_va = c * vv + s * va, c * va + s * aa
        f_av, f_aa = c * va - b * vv, c * aa - b * va
        pp = f_pp + s * f_pv + r * f_pa + index * jerk[0]
        pv = c * f_pv + s * f_pa + index * jerk[1]
        pa = c * f_pa - b * f_pv + index * jerk[2]
        vv = c * f_vv + s * f_va + index * jerk[3]
        va = c * f_va - b * f_vv + index * jerk[4]
        aa = c * f_aa - b * f_av + index * jerk[5]
        expected = pp + 1.0
        kp, kv, ka = pp / expected, pv / expected, pa / expected
        off = point - x
        left = (kp, kv, ka, vv - kv * pv, va - kv * pa, aa - ka * pa)
        return (
            Oscillator(x + kp * off, v + kv * off, a + ka * off, left),
            off / math.sqrt(expected),
        )


def _corrected(covariance: Covariance2, dt: float, index: float) -> tuple[Covariance2, float]:
    """The covariance after a point, whose first two numbers are the gains; and what was expected.

    Of a model of nearly constant velocity with white acceleration.
    """
    pp, pv, vv = covariance
    pp += dt * (2.0 * pv + dt * vv) + index * dt * dt * dt / 3.0
    pv += dt * vv + 0.5 * index * dt * dt
    vv += index * dt
    expected = pp + 1.0
    gain, by_velocity = pp / expected, pv / expected
    return (gain, by_velocity, vv - by_velocity * pv), expected


def _corrected_by(
    state: tuple[float, float], gains: Covariance2, point: float
) -> tuple[tuple[float, float], float]:
    """Predicted position and velocity after a point, and its innovation [rad]."""
    position, velocity = state
    off = point - position
    return (position + gains[0] * off, velocity + gains[1] * off), off


def _alarmed(before: Bearing, innovations: Six, kept: float) -> Six:
    """How strongly each model is to be doubted: two large innovations in a row to one side."""
    if max(map(abs, innovations)) < _DEVIATIONS and max(before.alarm) < _NO_ALARM:
        return _CALM_MODELS
    alarm = []
    for now, then, doubt in zip(innovations, before.innovations, before.alarm, strict=True):
        both = min(abs(now), abs(then)) if now * then > 0.0 else 0.0
        alarm.append(max(max(both - _DEVIATIONS, 0.0) ** 2, doubt * kept))
    return _six(alarm)


def _weights(scores: Six, alarm: Six, variance: float) -> Six:
    off, least = _NOISE_OFF * variance, _LEAST_SCORE * variance
    errors = [max(score - off, least) for score in scores]
    best = min(errors)
    if alarm is _CALM_MODELS:
        a, b, c, d, e, f = [(best / error) ** _SHARPNESS for error in errors]
        total = a + b + c + d + e + f
        return a / total, b / total, c / total, d / total, e / total, f / total
    calmest = min(alarm)
    raw = [
        (best / error) ** _SHARPNESS * math.exp(0.5 * (calmest - doubt))
        for error, doubt in zip(errors, alarm, strict=True)
    ]
    total = sum(raw)
    return _six([weight / total for weight in raw])


def _mixed(gains: Gains, receding: float, b: Bearing) -> Bearing:
    """The bearing with its mixture, and the mixture's variances: within and between the models."""
    still, calm, walking, restless, first, second = b.weights
    one, two = b.oscillators
    position = (
        still * b.still
        + calm * b.calm[0]
        + walking * b.walking[0]
        + restless * b.restless[0]
        + first * one.position
        + second * two.position
    )
    walk, velocity = walking * b.walking[1], calm * b.calm[1] + restless * b.restless[1]
    swing = first * one.velocity + second * two.velocity
    acceleration = first * one.acceleration + second * two.acceleration
    motion = Motion(
        position,
        walk,
        max(walking, _LEAST_SHARE),
        receding,
        velocity,
        swing,
        acceleration,
        max(b.oscillation.rate, _LEAST_RATE),
    )
    speed = walk + velocity + swing
    certainty = (
        b.variance
        * (
            still * gains.still
            + calm * gains.calm[0]
            + walking * gains.walking[0]
            + restless * gains.restless[0]
            + first * one.covariance[0]
            + second * two.covariance[0]
        )
        + still * (b.still - position) ** 2
        + calm * (b.calm[0] - position) ** 2
        + walking * (b.walking[0] - position) ** 2
        + restless * (b.restless[0] - position) ** 2
        + first * (one.position - position) ** 2
        + second * (two.position - position) ** 2,
        b.variance
        * (
            calm * gains.calm[2]
            + walking * gains.walking[2]
            + restless * gains.restless[2]
            + first * one.covariance[3]
            + second * two.covariance[3]
        )
        + still * speed**2
        + calm * (b.calm[1] - speed) ** 2
        + walking * (b.walking[1] - speed) ** 2
        + restless * (b.restless[1] - speed) ** 2
        + first * (one.velocity - speed) ** 2
        + second * (two.velocity - speed) ** 2,
    )
    return b._replace(motion=motion, certainty=certainty)


def _between(stamps: Sequence[float], points: Sequence[float], time: float) -> tuple[float, float]:
    """The point at a time between two, and the part of the noise that is left of theirs."""
    after = bisect_right(stamps, time)
    before = after - 1
    share = (time - stamps[before]) / (stamps[after] - stamps[before])
    point = points[before] + share * (points[after] - points[before])
    return point, (1.0 - share) ** 2 + share**2


def _six(numbers: Sequence[float]) -> Six:
    a, b, c, d, e, f = numbers
    return a, b, c, d, e, f
