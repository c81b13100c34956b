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
    """

    def __init__(
        self, clock: Callable[[], float], steady: Callable[[], float] = time.monotonic
    ) -> None:
        self.standing = ""
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
        return now + min(self._speed * (self._steady() - self._changed), self._piece)

    def check(self, *, simulated: bool) -> str:
        """What has happened to the clock since the last check, if it is more than time going by.

        Args:
            simulated: it follows /clock: it may run at any speed, and stop.
        """
        before = self._steady()
        now = self._clock()
        steady = self._steady()
        if steady - before > _LOOK and not simulated:
            return ""  # this thread was interrupted between the two
        last, self._last = self._last, (now, steady)
        if last is None:
            self._changed = steady
            return ""
        passed, really = now - last[0], steady - last[1]
        if passed and simulated:
            self._piece = passed if 0.0 < passed < _SIMULATED_STEP else 0.0
            speed = min(self._piece / max(steady - self._changed, 1e-3), _FASTEST)
            self._speed += _SMOOTHING * (speed - self._speed)
        if passed or not simulated:
            self._changed, self.standing = steady, ""
        elif not self.standing and steady - self._changed > _STILL:
            self.standing = (
                "the clock stands still: /clock is paused or silent"
                if now
                else "use_sim_time is set, but nobody publishes /clock"
            )
            return self.standing
        if simulated:
            runs = 0.0 <= passed <= max(_SIMULATED_STEP, _FASTEST * really)
            off = 0.0 if runs or not last[0] else passed
        else:
            off = passed - really if abs(passed - really) > _STEP else 0.0
        if not off:
            return ""
        return f"the clock jumped {'forward' if off > 0.0 else 'back'} by {abs(off):.3g} s"
