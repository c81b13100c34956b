"""A bank of Kalman filters of a moving point, from sluggish to agile, straight and swinging.

Every coordinate has filters of three kinds. Steady ones take the acceleration to be constant but
for white jerk, the restless one the velocity but for white acceleration (Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, sections 6.2.2 and 6.2.3);
swinging ones take the coordinate to swing about some centre, at a rate that is learned from the
points. Covariances are in units of the variance of a point, so that one number decides how a
filter behaves: its agility, the spectral density of the disturbance over that variance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

STEADY = (2e4, 5e6)
"""Agilities [1/s^5] of the steady filters: calm and lively."""

RESTLESS = 3e5
"""Agility [1/s^3] of the filter for targets that turn on the spot."""

SWINGING = (1e3, 5e5)
"""Agilities [1/s^5] of the filters that swing."""

AGILITIES: Array = np.array((*STEADY, 0.0, *SWINGING))
"""How much white jerk every filter expects [1/s^5]."""

THE_RESTLESS = len(STEADY)
"""Its place in the bank; what swings comes after it."""

_SWINGS = THE_RESTLESS + 1

# What is known of a target seen once, in units of a point's standard deviation. Bearings of
# 2 mrad make this 2 rad/s and 2 rad/s^2: more would let the second point throw the head.
_JERK: Array = AGILITIES[:, None, None]
_UNKNOWN: Array = np.diag([1.0, 1e6, 1e6])
_LEAST_SWING = 1e-3  # rad/s; below it a swing is a constant acceleration


class Bank(NamedTuple):
    """What all filters know after a point; c coordinates, f filters.

    Attributes:
        states: position, velocity, acceleration; shape (c, f, 3) [m, m/s, m/s^2].
        covariances: of the states, in units of the variance of a point; shape (c, f, 3, 3).
    """

    states: Array
    covariances: Array

    @staticmethod
    def seen_once(point: Array) -> Bank:
        """A target of which only one point is known, shape (c,) [m]."""
        size = len(point), len(AGILITIES)
        states = np.zeros((*size, 3))
        states[:, :, 0] = point[:, None]
        return Bank(states, np.broadcast_to(_UNKNOWN, (*size, 3, 3)).copy())

    def positions_after(self, dt: float, swing: Array) -> Array:
        """The position by every filter, shape (c, f) [m], a time `dt` [s] later.

        Args:
            dt: [s], may be negative.
            swing: rate of the swing of every coordinate, shape (c,) [rad/s].
        """
        by_velocity = np.full(self.states.shape[:2], dt)
        by_acceleration = np.full(self.states.shape[:2], 0.5 * dt * dt)
        for coordinate, rate in enumerate(swing.tolist()):
            if rate > _LEAST_SWING:
                by_velocity[coordinate, _SWINGS:] = math.sin(rate * dt) / rate
                by_acceleration[coordinate, _SWINGS:] = (1.0 - math.cos(rate * dt)) / (rate * rate)
        position, velocity, acceleration = self.states.transpose(2, 0, 1)
        return np.asarray(position + by_velocity * velocity + by_acceleration * acceleration)

    def corrected(self, dt: float, swing: Array, point: Array) -> tuple[Bank, Array]:
        """The bank after a point, and how well the point fitted.

        Args:
            dt: time since the point before [s], 0 or more.
            swing: rate of the swing of every coordinate, shape (c,) [rad/s].
            point: shape (c,) [m].

        Returns:
            The bank; and how far the point was from the predicted position, over the expected
            deviation in units of the deviation of a point, shape (c, f) [m].
        """
        transition = _transition(dt, swing)
        covariances = transition @ self.covariances @ transition.swapaxes(2, 3)
        disturbance = _disturbance(dt)
        covariances += _JERK * disturbance
        covariances[:, THE_RESTLESS, :2, :2] += RESTLESS * disturbance[1:, 1:]
        states = np.matmul(transition, self.states[..., None])[..., 0]
        first = covariances[..., 0]
        expected = first[..., 0] + 1.0
        gains = first / expected[..., None]
        surprise = point[:, None] - states[..., 0]
        states += gains * surprise[..., None]
        covariances -= gains[..., None] * first[..., None, :]
        return Bank(states, covariances), surprise / np.sqrt(expected)


def _transition(dt: float, swing: Array) -> Array:
    """The states' transition over `dt`, shape (c, f, 3, 3)."""
    steady = np.array((1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0)).reshape(3, 3)
    matrix = np.empty((len(swing), len(AGILITIES), 3, 3))
    matrix[:] = steady
    matrix[:, THE_RESTLESS, :, 2] = 0.0
    for coordinate, rate in enumerate(swing.tolist()):
        if rate > _LEAST_SWING:
            sine, cosine = math.sin(rate * dt), math.cos(rate * dt)
            matrix[coordinate, _SWINGS:] = (
                (1.0, sine / rate, (1.0 - cosine) / (rate * rate)),
                (0.0, cosine, sine / rate),
                (0.0, -rate * sine, cosine),
            )
    return matrix


def _disturbance(dt: float) -> Array:
    """The covariance that white jerk of density 1 adds in a time `dt`, shape (3, 3)."""
    d2, d3 = dt * dt, dt**3
    pp, pv, pa, vv, va = d3 * d2 / 20.0, d2 * d2 / 8.0, d3 / 6.0, d3 / 3.0, d2 / 2.0
    return np.array((pp, pv, pa, pv, vv, va, pa, va, dt)).reshape(3, 3)
