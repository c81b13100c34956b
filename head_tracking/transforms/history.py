"""Samples over time, with interpolation between them and never beyond."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import MutableSequence
from typing import Generic, TypeVar

from head_tracking.transforms.transform import Transform

DEFAULT_CACHE_TIME = 10_000_000_000  # 10 s in ns, tf2's default

_TRIM_BATCH = 64  # dropping old samples one at a time would move the whole array each time

Value = TypeVar("Value")


class History(Generic[Value]):
    """Samples of one quantity, sorted by stamp [ns], of the last `cache_time` [ns]."""

    def __init__(self, values: MutableSequence[Value], cache_time: int) -> None:
        self._stamps = array("q")
        self._values = values
        self._cache_time = cache_time

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def oldest(self) -> int:
        """The stamp of the oldest sample [ns]."""
        return self._stamps[0]

    @property
    def latest(self) -> int:
        """The stamp of the newest sample [ns]."""
        return self._stamps[-1]

    @property
    def newest_value(self) -> Value:
        """The value of the newest sample."""
        return self._values[-1]

    def insert(self, stamp: int, value: Value) -> bool:
        """Takes a sample, also one that comes late.

        Returns:
            False if the sample was not taken: older than the cache, or its stamp is there already.
        """
        stamps = self._stamps
        if not stamps or stamp > stamps[-1]:
            stamps.append(stamp)
            self._values.append(value)
            self._trim()
            return True
        if stamp < stamps[-1] - self._cache_time:
            return False
        index = bisect_left(stamps, stamp)
        if stamps[index] == stamp:
            return False
        stamps.insert(index, stamp)
        self._values.insert(index, value)
        return True

    def clear(self) -> None:
        """Forgets everything."""
        del self._stamps[:]
        del self._values[:]

    def at(self, stamp: int) -> Value:
        """The value at `stamp` [ns], which must lie within oldest and latest."""
        stamps = self._stamps
        index = bisect_left(stamps, stamp)
        if stamps[index] == stamp:
            return self._values[index]
        before = stamps[index - 1]
        ratio = (stamp - before) / (stamps[index] - before)
        return self._interpolate(self._values[index - 1], self._values[index], ratio)

    def _interpolate(self, before: Value, after: Value, ratio: float) -> Value:
        raise NotImplementedError

    def _trim(self) -> None:
        horizon = self._stamps[-1] - self._cache_time
        if self._stamps[0] >= horizon:
            return
        expired = bisect_left(self._stamps, horizon)
        # a batch at a time, but all at once after a pause
        if expired >= _TRIM_BATCH or expired >= len(self._stamps) // 2:
            del self._stamps[:expired]
            del self._values[:expired]


class JointHistory(History[float]):
    """Positions of one joint [rad or m].

    Attributes:
        continuous: the joint turns without end: between two samples it went the short way.
    """

    def __init__(self, *, continuous: bool = False, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        super().__init__(array("d"), cache_time)
        self.continuous = continuous

    def _interpolate(self, before: float, after: float, ratio: float) -> float:
        difference = after - before
        if self.continuous:
            difference = math.remainder(difference, math.tau)
        return before + ratio * difference


class TransformHistory(History[Transform]):
    """Transforms of one frame in its parent."""

    def __init__(self, *, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        super().__init__([], cache_time)

    def _interpolate(self, before: Transform, after: Transform, ratio: float) -> Transform:
        return before.interpolate(after, ratio)
