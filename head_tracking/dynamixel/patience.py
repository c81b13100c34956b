"""How long an answer is waited for: as long as answers take here, and a margin."""

from __future__ import annotations

from typing import Final

_SHORTEST: Final = 0.0017
"""A quiet machine wakes the reader up within a millisecond; less would cry wolf."""

_LONGEST: Final = 0.025
"""Leaves room for an FTDI adapter's 16 ms, which it takes unless told otherwise."""

_MARGIN: Final = 0.0012
_DEVIATIONS: Final = 6.0
_GAIN: Final = 1.0 / 16.0


class Patience:
    """Follows the time between the last byte of a question and the last byte of its answer.

    That is the servo's return delay, the adapter's latency and the time until this program runs,
    without the time on the wire. Mean and mean deviation are followed as TCP does it.

    Args:
        fixed: Always allow this time, s, instead; None follows.
        adapter: What the adapter is known to take, s; None if it does not tell.
    """

    def __init__(self, fixed: float | None = None, adapter: float | None = None) -> None:
        self._fixed = fixed
        self._mean = 0.0
        self._deviation = 0.0
        self._known = False
        self.allowance = fixed if fixed is not None else _first_allowance(adapter)

    def learn(self, latency: float) -> None:
        """Take account of an answer, unless it took too long to ever wait for.

        Args:
            latency: How long it took besides the time on the wire, s.
        """
        if self._fixed is not None or latency > _LONGEST:
            return
        if not self._known:
            self._known = True
            self._mean = latency
            self._deviation = latency / 2.0
        else:
            error = latency - self._mean
            self._mean += _GAIN * error
            self._deviation += _GAIN * (abs(error) - self._deviation)
        wanted = self._mean + _DEVIATIONS * self._deviation + _MARGIN
        if wanted < _SHORTEST:
            wanted = _SHORTEST
        self.allowance = wanted if wanted < _LONGEST else _LONGEST


def _first_allowance(adapter: float | None) -> float:
    if adapter is None:
        return _LONGEST
    return min(_LONGEST, adapter + 0.008)
