"""Samples over time, with interpolation between them and never beyond."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import Generic, TypeVar

from head_tracking.transforms.transform import Transform

DEFAULT_CACHE_TIME = 10_000_000_000  # 10 s in ns, tf2's default

NEVER = -1
"""The stamp of what was not sampled yet."""

DROP_BATCH = 256
"""So many old samples are dropped at once: one at a time would move the whole list each time."""

Value = TypeVar("Value")


class History(Generic[Value]):
    """Samples of one quantity of the last `cache_time` [ns] before the newest one.

    The lists are kept for good, and compiled lookups hold on to them. They begin with an entry
    that never was, so that there is always one to look at; then may come samples that are older
    than the cache, until there are enough to be dropped at once.

    Attributes:
        stamps: when the samples were taken [ns], sorted; the last one is the newest.
        values: the samples.
        cache_time: how old a sample may be asked for [ns].
        drop_at: old samples are to be dropped when the lists are longer.
    """

    __slots__ = ("cache_time", "drop_at", "stamps", "values")

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        self.cache_time = cache_time
        self.stamps: list[int] = []
        self.values: list[Value | None] = []
        self.clear()

    def __len__(self) -> int:
        return len(self.stamps) - self._first()

    def clear(self) -> None:
        """Forgets everything."""
        self.stamps[:] = [NEVER]
        self.values[:] = [None]
        self.drop_at = DROP_BATCH

    @property
    def latest(self) -> int:
        """The stamp of the newest sample [ns]; NEVER without one."""
        return self.stamps[-1]

    @property
    def oldest(self) -> int:
        """The oldest time that can be asked for [ns]; NEVER without a sample."""
        if len(self.stamps) == 1:
            return NEVER
        return max(self.stamps[1], self.stamps[-1] - self.cache_time)

    @property
    def newest(self) -> Value:
        """The value of the newest sample, if there is one."""
        return self.values[-1]  # type: ignore[return-value]

    def insert(self, stamp: int, value: Value) -> bool:
        """Takes a sample, also one that comes late; of two with one stamp the later to come.

        Returns:
            False if the sample is older than the cache and was not taken.
        """
        stamps = self.stamps
        if stamp <= stamps[-1]:
            return self._insert_late(stamp, value)
        stamps.append(stamp)
        self.values.append(value)
        if len(stamps) > self.drop_at:
            self.drop_old()
        return True

    def at(self, stamp: int) -> Value:
        """The value at `stamp` [ns], which must lie within oldest and latest."""
        index = bisect_left(self.stamps, stamp, 1)
        after = self.stamps[index]
        if after == stamp:
            return self.values[index]  # type: ignore[return-value]
        before = self.stamps[index - 1]
        return self._between(index, (stamp - before) / (after - before))

    def _between(self, index: int, ratio: float) -> Value:
        """The value on the way from the sample before `index` to that one."""
        raise NotImplementedError

    def _insert_late(self, stamp: int, value: Value) -> bool:
        if stamp < self.latest - self.cache_time:
            return False
        index = bisect_left(self.stamps, stamp, 1)
        if self.stamps[index] == stamp:
            self.values[index] = value
        else:
            self.stamps.insert(index, stamp)
            self.values.insert(index, value)
        return True

    def _first(self) -> int:
        """The index of the first sample that is not older than the cache."""
        return bisect_left(self.stamps, self.latest - self.cache_time, 1)

    def drop_old(self) -> None:
        """Drops what is older than the cache."""
        # the newest of the old ones stays, for times between it and the next
        keep = max(1, self._first() - 1)
        del self.stamps[1:keep]
        del self.values[1:keep]
        self.drop_at = len(self.stamps) + DROP_BATCH


class JointHistory(History[float]):
    """Positions of one joint [rad or m].

    Attributes:
        joint: its name.
        continuous: the joint turns without end: between two samples it went the short way.
    """

    __slots__ = ("continuous", "joint")

    def __init__(
        self,
        joint: str = "",
        *,
        continuous: bool = False,
        cache_time: int = DEFAULT_CACHE_TIME,
    ) -> None:
        super().__init__(cache_time)
        self.joint = joint
        self.continuous = continuous

    def _between(self, index: int, ratio: float) -> float:
        before, after = self.values[index - 1], self.values[index]
        assert before is not None
        assert after is not None
        difference = after - before
        if self.continuous:
            difference = math.remainder(difference, math.tau)
        return before + ratio * difference


class TransformHistory(History[tuple[str, Transform]]):
    """Parents of one frame, and the transforms in them; between two parents the older one holds."""

    __slots__ = ()

    def parents(self) -> set[str]:
        """All parents within the cache; one only, unless the frame was handed over."""
        return {pair[0] for pair in self.values[self._first() :] if pair is not None}

    def _between(self, index: int, ratio: float) -> tuple[str, Transform]:
        older, newer = self.values[index - 1], self.values[index]
        assert older is not None
        assert newer is not None
        if older[0] != newer[0]:
            return older
        return older[0], older[1].interpolate(newer[1], ratio)
