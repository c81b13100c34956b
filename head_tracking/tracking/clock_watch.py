"""Notices clocks that jump or stand still."""

from __future__ import annotations

import time
from collections.abc import Callable

_STEP = 0.1  # s; by less, a clock that is being set right may go wrong at once
_LOOK = 0.02  # s; a look at both clocks that takes longer says nothing
_SIMULATED_STEP = 1.0  # s; simulated time comes in pieces
_FASTEST = 10.0  # times as fast as real time a simulation may be
_STILL = 1.0  # s
_SMOOTHING = 0.2  # of the speed of simulated time, from one message to the next


class ClockWatch:
    """Watches a clock by another one that never jumps.

    Args:
        clock: the one that is watched [s]; 0 while a simulated clock was not told the time yet.
        steady: the other one [s].

    Attributes:
        standing: why the clock stands still; empty while it runs.
        checked: the time [s] at the last check.
    """

    def __init__(
        self, clock: Callable[[], float], steady: Callable[[], float] = time.monotonic
    ) -> None:
        self.standing = ""
        self.checked = 0.0
        self._clock = clock
        self._steady = steady
        self._last: tuple[float, float] | None = None
        self._changed = steady()
        self._piece = self._speed = 0.0

    def now(self, *, simulated: bool) -> float:
        """The time [s]; between two messages of /clock it goes on, by one such piece at most."""
        now = self._clock()
        if not simulated or self._last is None or now != self._last[0]:
            return now
        return self._between(now, self._steady())

    def _between(self, now: float, steady: float) -> float:
        return now + min(self._speed * (steady - self._changed), self._piece)

    def check(self, *, simulated: bool) -> str:
        """What has happened to the clock since the last check, if it is more than time going by.

        Args:
            simulated: it follows /clock: it may run at any speed, and stop.
        """
        before = self._steady()
        now = self._clock()
        steady = self._steady()
        self.checked = now
        if steady - before > _LOOK and not simulated:
            return ""  # this thread was interrupted between the two
        last, self._last = self._last, (now, steady)
        if last is None:
            self._changed = steady
            return ""
        passed, really = now - last[0], steady - last[1]
        if simulated:
            return self._check_simulated(now, steady, passed, really)
        self._changed, self.standing = steady, ""
        return _jumped(passed - really) if abs(passed - really) > _STEP else ""

    def _check_simulated(self, now: float, steady: float, passed: float, really: float) -> str:
        if not passed:
            self.checked = self._between(now, steady)
            if self.standing or steady - self._changed <= _STILL:
                return ""
            self.standing = (
                "the clock stands still: /clock is paused or silent"
                if now
                else "use_sim_time is set, but nobody publishes /clock"
            )
            return self.standing
        self._piece = passed if 0.0 < passed < _SIMULATED_STEP else 0.0
        speed = min(self._piece / max(steady - self._changed, 1e-3), _FASTEST)
        self._speed += _SMOOTHING * (speed - self._speed)
        self._changed, self.standing = steady, ""
        runs = 0.0 <= passed <= max(_SIMULATED_STEP, _FASTEST * really)
        begins = now == passed
        return "" if runs or begins else _jumped(passed)


def _jumped(by: float) -> str:
    return f"the clock jumped {'forward' if by > 0.0 else 'back'} by {abs(by):.1f} s"
