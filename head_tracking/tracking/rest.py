"""When a joint may fall silent, and where it stays."""

from __future__ import annotations

import math
from dataclasses import dataclass

_CALM = 0.1  # s; for so long a joint must have been where it should be
_SETTLED = 0.2  # s after which a joint that stopped short is helped
_AIM = 1.0  # s; over which the place of a joint at rest is averaged, and aimed at again
_SLOW = 0.015  # rad/s; a target slower than this may be one that stands still
_FARTHEST_HELP = 3.0  # resolutions of the encoder


@dataclass(frozen=True, slots=True)
class Wish:
    """Where a joint should be.

    Attributes:
        position: [rad].
        velocity: [rad/s].
        noise: standard deviation of that position [rad].
        speed_noise: standard deviation of that velocity [rad/s].
    """

    position: float
    velocity: float = 0.0
    noise: float = 0.0
    speed_noise: float = 0.0


class Rest:
    """A dead band with hysteresis: easy to stay in, harder to come into.

    Attributes:
        goal: where the joint rests [rad]; None while it moves.
        near: whether the joint is wanted where it may come to rest.
    """

    def __init__(self) -> None:
        self.goal: float | None = None
        self.near = False
        self._place = 0.0
        self._calm_since: float | None = None
        self._mean = 0.0
        self._helped = self._aimed = self._judged = 0.0

    def wake(self) -> None:
        """The joint moves."""
        self.goal = self._calm_since = None

    def judge(
        self, wish: Wish, off: float, speed: float, setpoint: float, dead_band: float, now: float
    ) -> None:
        """Decides whether the joint rests.

        Args:
            wish: where it should be.
            off: by how much its intended motion is not there [rad].
            speed: of its intended motion [rad/s].
            setpoint: where the servo would stay if it were told nothing any more [rad].
            dead_band: errors below this are left alone [rad].
            now: the time [s].
        """
        band = max(dead_band, min(3.0 * wish.noise, 4.0 * dead_band))
        slow = min(max(2.0 * wish.speed_noise, _SLOW), 4.0 * _SLOW)
        self.near = abs(wish.velocity) <= slow
        if self.goal is not None:
            if abs(wish.position - self._place) > band or abs(wish.velocity) > 2.5 * slow:
                self.wake()
                return
            self._mean += min((now - self._judged) / _AIM, 1.0) * (wish.position - self._mean)
            self._judged = now
            off = self._mean - self._place
            if abs(off) > 0.5 * dead_band and now - self._aimed >= _AIM:
                self.goal += off
                self._place, self._aimed = self._mean, now
            return
        if not self.near or abs(speed) > slow or abs(off) > 0.5 * band:
            self._calm_since = None
            return
        if self._calm_since is None:
            self._calm_since = now
        if now - self._calm_since >= _CALM:
            self.goal, self._place = setpoint, wish.position
            self._mean = wish.position
            self._helped = self._aimed = self._judged = now

    def help(self, measured: float, stamp: float, resolution: float, dead_band: float) -> None:
        """Moves the goal of a joint that came to rest beside its place.

        Args:
            measured: where it stands [rad].
            stamp: when that was [s].
            resolution: of its encoder [rad].
            dead_band: errors below this are left alone [rad].
        """
        short = self._place - measured
        if self.goal is None or abs(short) <= max(dead_band, 0.75 * resolution):
            return
        if stamp - self._helped >= _SETTLED:
            self._helped = stamp
            farthest = _FARTHEST_HELP * resolution
            ahead = self.goal - self._place + short
            if ahead * short < 0.0:
                ahead = math.copysign(resolution, short)
            self.goal = self._place + min(max(ahead, -farthest), farthest)
