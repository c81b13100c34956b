"""Score hypotheses by how well filters predict the bearings that each of them gives a target."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_NOISE = 0.002  # rad; of a bearing
_MANOEUVRE: Array = np.array([0.05, 0.05, 2.0, 2.0, 40.0, 40.0])[:, None]
"""Spectral density of the target's acceleration in each filter [rad^2/s^3]."""
_JITTER: Array = np.tile([0.003, 0.012], 3)[:, None]
"""Standard deviation of the stamps in each filter [s]."""
_STEADY = 4  # filters with low process noise; the others are for targets that manoeuvre
_FIRST_SPEED = 1.0  # rad/s; standard deviation before the second point
_DEGREES = 4.0  # of freedom of the t distribution, which limits the effect of outliers
_GATE = 30.0  # squared deviations from the nearest prediction; farther points are skipped
_SKIPPED = 3  # skipped points in a row; after more the filters restart
_GAP = 1.0  # s
_LEAST = -4.0  # lowest score of one point, relative to the best hypothesis
_SHARE = 0.6  # factor on the score of a point: consecutive points are not independent
_FILTER_MEMORY = 1.0  # s; time constant of the weights of the filters
_MEMORY = 3.0  # s; time constant of the scores, in points that distinguish hypotheses
_NEVER = -1e6


class HypothesisBank:
    """Score hypotheses by near-constant-velocity filters of the bearings that each one gives.

    The filters' gains do not depend on the hypothesis, so that only their means are kept for each.

    Args:
        count: of hypotheses, N.
        steady: hypotheses for which only the filters with low process noise count, shape (N,).

    Attributes:
        scores: log likelihoods, relative to the best and forgotten over 3 s, shape (N,). Points
            that do not distinguish the hypotheses do not reduce the scores.
    """

    def __init__(self, count: int, steady: npt.NDArray[np.bool_] | None = None) -> None:
        self.scores = np.zeros(count)
        self._allowed = np.zeros((len(_JITTER), count))
        if steady is not None:
            self._allowed[_STEADY:, steady] = _NEVER
        self._stamp = -math.inf
        self._position: Array
        self._velocity: Array
        self._pp: Array
        self._pv: Array
        self._vv: Array
        self._weights: Array
        self._skipped = 0
        self._begin(np.zeros((2, count)), np.ones((2, len(_JITTER), 1)))

    def add(self, stamp: float, bearings: Array, speeds: Array) -> None:
        """Score the hypotheses by a point, and update the filters.

        Args:
            stamp: of the point [s]; later than the one before.
            bearings: azimuth and elevation by each hypothesis, shape (2, N) [rad].
            speeds: of pan and tilt, shape (2,) [rad/s]; jitter of the stamps counts in motion only.
        """
        variance = _NOISE**2 + (_JITTER * speeds[:, None, None]) ** 2
        dt = stamp - self._stamp
        if dt > _GAP:
            self._stamp = stamp
            self._begin(bearings, variance)
            return
        pp = self._pp + dt * (2.0 * self._pv + dt * self._vv) + _MANOEUVRE * (dt**3 / 3.0)
        pv = self._pv + dt * self._vv + _MANOEUVRE * (dt * dt / 2.0)
        vv = self._vv + _MANOEUVRE * dt
        expected = pp + variance
        position = self._position + dt * self._velocity
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
        gain, by_velocity = pp / expected, pv / expected
        self._position, self._velocity = position + gain * off, self._velocity + by_velocity * off
        self._pp, self._pv, self._vv = (
            pp - gain * pp,
            pv - gain * pv,
            np.maximum(vv - by_velocity * pv, 0.0),
        )

    def keep(self, chosen: npt.NDArray[np.bool_]) -> None:
        """Drop all other hypotheses."""
        self.scores = self.scores[chosen]
        self._allowed, self._weights = self._allowed[:, chosen], self._weights[:, chosen]
        self._position, self._velocity = self._position[..., chosen], self._velocity[..., chosen]

    def _begin(self, bearings: Array, variance: Array) -> None:
        """Restart all filters at a point; the scores are kept."""
        self._position = np.repeat(bearings[:, None], len(_JITTER), axis=1)
        self._velocity = np.zeros_like(self._position)
        self._pp, self._pv = variance, np.zeros_like(variance)
        self._vv = np.full_like(variance, _FIRST_SPEED**2)
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
        self._weights = math.exp(-dt / _FILTER_MEMORY) * (weights - best) + self._allowed
        mixed = np.maximum(mixed - mixed.max(), _LEAST)
        distinct = min(1.0, 2.0 * float(mixed.std()))
        scores = math.exp(-dt * distinct / _MEMORY) * self.scores + _SHARE * mixed
        self.scores = scores - scores.max()
