"""Score hypotheses by how well filters predict the bearings that each of them gives a target."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from head_tracking.tracking.multiple_model import moved_covariance, transition

Array = npt.NDArray[np.float64]

_NOISE: Array = np.tile([0.002, 0.005], 3)[:, None]
"""Standard deviation of a bearing in each filter [rad]."""
_MANOEUVRE: Array = np.array([0.05, 0.05, 2.0, 2.0, 0.0, 0.0])[:, None]
"""Spectral density of the target's acceleration in each filter [rad^2/s^3]."""
_JERK: Array = np.array([0.0, 0.0, 0.0, 0.0, 30.0, 30.0])[:, None]
"""Spectral density of its jerk [rad^2/s^5]; above 0, the filter is harmonic."""
_JITTER: Array = np.tile([0.003, 0.012], 3)[:, None]
"""Standard deviation of the stamps in each filter [s]."""
_STEADY = 4  # near-constant-velocity filters; the others are for targets that oscillate
_FIRST_SPEED = 1.0  # rad/s; standard deviation before the second point
_FIRST_ACCELERATION = 5.0  # rad/s^2; the same, in harmonic filters
_DEGREES = 4.0  # of freedom of the t distribution, which limits the effect of outliers
_GATE = 30.0  # squared deviations from the nearest prediction; farther points are skipped
_SKIPPED = 3  # skipped points in a row; after more the filters restart
_GAP = 1.0  # s
_DOUBT = 3.0  # lowest score after `doubt`
_LEAST = -4.0  # lowest score of one point, relative to the best hypothesis
_EXPLAINED = 2.0  # mean squared deviations of a bearing; above, the target moves as no filter does
_SHARE = 0.6  # factor on the score of a point: consecutive points are not independent
_FILTER_MEMORY = 1.0  # s; time constant of the filters' weights, and of their squared deviations
_MEMORY = 3.0  # s; time constant of the scores, in points that distinguish hypotheses
_NEVER = -1e6


class HypothesisBank:
    """Score hypotheses by near-constant-velocity and harmonic filters of the bearings they give.

    The harmonic filters predict an oscillation of any amplitude equally well. Without them, a
    hypothesis that only makes the target's oscillation smaller would have the better score.
    The filters' gains do not depend on the hypothesis, so that only their means are kept for each.

    Args:
        count: of hypotheses, N.
        steady: hypotheses for which only the filters with low process noise count, shape (N,).

    Attributes:
        scores: log likelihoods, relative to the best and forgotten over 3 s, shape (N,). Points
            that do not distinguish the hypotheses do not reduce the scores. Points count less
            while no hypothesis predicts them well.
    """

    def __init__(self, count: int, steady: npt.NDArray[np.bool_] | None = None) -> None:
        self.scores = np.zeros(count)
        self._allowed = np.zeros((len(_JITTER), count))
        if steady is not None:
            self._allowed[_STEADY:, steady] = _NEVER
        self._stamp = -math.inf
        self._position: Array
        self._velocity: Array
        self._acceleration: Array
        self._covariance: tuple[Array, ...]
        self._weights: Array
        self._skipped = 0
        self._off = np.ones(count)  # mean squared deviations of a bearing from its prediction
        self._begin(np.zeros((2, count)), np.ones((2, len(_JITTER), 1)))

    @property
    def explains(self) -> bool:
        """Whether the hypothesis with the best score predicts the bearings."""
        return bool(self._off[self.scores.argmax()] < 2.0 * _EXPLAINED)

    def add(self, stamp: float, bearings: Array, speeds: Array, rate: float) -> None:
        """Score the hypotheses by a point, and update the filters.

        Args:
            stamp: of the point [s]; later than the one before.
            bearings: azimuth and elevation by each hypothesis, shape (2, N) [rad].
            speeds: of pan and tilt, shape (2,) [rad/s]; jitter of the stamps counts in motion only.
            rate: of the target's oscillation [rad/s]; 0: unknown, its acceleration is constant.
        """
        variance = _NOISE**2 + (_JITTER * speeds[:, None, None]) ** 2
        dt = stamp - self._stamp
        if dt > _GAP:
            self._stamp = stamp
            self._begin(bearings, variance)
            return
        sine, cosine, rise, back = swing = tuple(
            np.where(_JERK > 0.0, harmonic, steady)
            for harmonic, steady in zip(transition(dt, rate), (dt, 1.0, 0.0, 0.0), strict=True)
        )
        q, j = _MANOEUVRE, _JERK
        noise = (
            q * (dt**3 / 3.0) + j * (dt**5 / 20.0),
            q * (dt * dt / 2.0) + j * (dt**4 / 8.0),
            j * (dt**3 / 6.0),
            q * dt + j * (dt**3 / 3.0),
            j * (dt * dt / 2.0),
            j * dt,
        )
        pp, pv, pa, vv, va, aa = moved_covariance(self._covariance, swing, noise)
        expected = pp + variance
        position = self._position + sine * self._velocity + rise * self._acceleration
        velocity = cosine * self._velocity + sine * self._acceleration
        acceleration = cosine * self._acceleration - back * self._velocity
        off = bearings[:, None] - position
        off[0] -= math.tau * np.round(off[0] / math.tau)
        squares = (off * off / expected).sum(axis=0)
        if not float(squares.min()) < _GATE:  # (also if it is not a number)
            self._skipped += 1
            if self._skipped > _SKIPPED:
                self._stamp = -math.inf
            return
        self._stamp, self._skipped = stamp, 0
        self._score(squares, expected, dt)
        k, kv, ka = pp / expected, pv / expected, pa / expected
        self._position, self._velocity = position + k * off, velocity + kv * off
        self._acceleration = acceleration + ka * off
        self._covariance = (
            pp - k * pp,
            pv - k * pv,
            pa - k * pa,
            np.maximum(vv - kv * pv, 0.0),
            va - kv * pa,
            np.maximum(aa - ka * pa, 0.0),
        )

    def doubt(self) -> None:
        """Keep less of what the points have shown: another hypothesis may be true from now on."""
        self.scores = np.maximum(self.scores, -_DOUBT)

    def keep(self, chosen: npt.NDArray[np.bool_]) -> None:
        """Drop all other hypotheses."""
        self.scores, self._off = self.scores[chosen], self._off[chosen]
        self._allowed, self._weights = self._allowed[:, chosen], self._weights[:, chosen]
        self._position, self._velocity = self._position[..., chosen], self._velocity[..., chosen]
        self._acceleration = self._acceleration[..., chosen]

    def _begin(self, bearings: Array, variance: Array) -> None:
        """Restart all filters at a point; the scores are kept."""
        self._position = np.repeat(bearings[:, None], len(_JITTER), axis=1)
        self._velocity = np.zeros_like(self._position)
        self._acceleration = np.zeros_like(self._position)
        none, speed = np.zeros_like(variance), np.full_like(variance, _FIRST_SPEED**2)
        acceleration = none + np.where(_JERK > 0.0, _FIRST_ACCELERATION**2, 0.0)
        self._covariance = variance, none, none, speed, none, acceleration
        self._weights = self._allowed
        self._skipped = 0

    def _score(self, squares: Array, expected: Array, dt: float) -> None:
        """Update the weights of the filters, shape (filters, N), and the scores."""
        likelihood = -0.5 * (_DEGREES + 2.0) * np.log1p(squares / _DEGREES)
        likelihood -= 0.5 * np.log(expected[0] * expected[1])
        weights = self._weights + likelihood
        before, best = self._weights.max(axis=0), weights.max(axis=0)
        mixed = np.log(np.exp(weights - best).sum(axis=0)) + best
        mixed -= np.log(np.exp(self._weights - before).sum(axis=0)) + before
        kept = math.exp(-dt / _FILTER_MEMORY)
        self._weights = kept * (weights - best) + self._allowed
        likely = self._weights.argmax(axis=0)[None]
        off = 0.5 * np.take_along_axis(squares, likely, axis=0)[0]
        self._off += (1.0 - kept) * (np.minimum(off, _GATE) - self._off)
        mixed = np.maximum(mixed - mixed.max(), _LEAST) / max(1.0, self._off.min() / _EXPLAINED)
        distinct = min(1.0, 2.0 * float(mixed.std()))
        scores = math.exp(-dt * distinct / _MEMORY) * self.scores + _SHARE * mixed
        self.scores = scores - scores.max()
