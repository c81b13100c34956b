"""Notices joints that fall silent."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

_PATIENCE = 2.0  # s


class JointWatch:
    """By the clock of this machine: stamps may be on another one, or stand still with it.

    Args:
        clock: time that never jumps [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._heard: dict[str, tuple[int | None, float]] = {}

    def silent(self, stamps: Mapping[str, int | None]) -> tuple[str, ...]:
        """The joints whose newest stamp has not changed for a while.

        Args:
            stamps: the newest of each joint that somebody should tell [ns]; None: never told.
        """
        now = self._clock()
        for joint in self._heard.keys() - stamps.keys():
            del self._heard[joint]
        for joint, stamp in stamps.items():
            if joint not in self._heard or self._heard[joint][0] != stamp:
                self._heard[joint] = stamp, now
        return tuple(joint for joint in stamps if now - self._heard[joint][1] > _PATIENCE)
