"""Detect clocks that jump or stop."""

from __future__ import annotations

import time
from collections.abc import Callable

_STEP = 0.1  # s; smaller steps of a clock are no jump
_LONGEST_READ = 0.02  # s; if reading the clocks takes longer, they are not compared
_SIMULATED_STEP = 1.0  # s; simulated time advances in steps
_FASTEST = 10.0  # highest ratio of simulated to real time
_STILL = 1.0  # s
_SMOOTHING = 0.2  # of the speed of simulated time, from one message to the next


class ClockWatch:
    """Compare a clock with a monotonic one.

    Args:
        clock: the clock to check [s]; 0 until a simulated clock has been set.
        steady: the monotonic clock [s].

    Attributes:
        standing: why the clock has stopped; empty while it runs.
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
        """Return the time [s], extrapolated between two messages of /clock by one step at most."""
        now = self._clock()
        if not simulated or self._last is None or now != self._last[0]:
            return now
        return self._between(now, self._steady())

    def _between(self, now: float, steady: float) -> float:
        return now + min(self._speed * (steady - self._changed), self._piece)

    def check(self, *, simulated: bool) -> str:
        """Return what is wrong with the clock since the last check; empty: nothing.

        Args:
            simulated: whether it follows /clock, which may run at any speed, and stop.
        """
        before = self._steady()
        now = self._clock()
        steady = self._steady()
        self.checked = now
        if steady - before > _LONGEST_READ and not simulated:
            return ""  # this thread was interrupted in between
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
                else "use_sim_time is set, but /clock is not published"
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
