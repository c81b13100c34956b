"""Samples over time by the rules of tf2's TimeCache: interpolated, never extrapolated."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from typing import Generic, TypeAlias, TypeVar

from head_tracking.transforms.exceptions import ExtrapolationException
from head_tracking.transforms.transform import Transform

DEFAULT_CACHE_TIME = 10_000_000_000  # 10 s in ns, tf2's default

LATEST = 0
"""tf2: the time 0 is the latest time."""

Sample: TypeAlias = tuple[str, Transform]
"""A parent, and the transform in it: `T_parent_child`."""

Value = TypeVar("Value")


class History(Generic[Value]):
    """Samples of one quantity.

    Attributes:
        stamps: times of the samples [ns], sorted.
        values: the samples.
        first: the index of the oldest sample. Items before it are deleted from time to time:
            deletion at the front moves all others.
        cache_time: how much older than the latest a sample may be [ns].
    """

    __slots__ = ("cache_time", "first", "stamps", "values")
    _replaces = False

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        self.cache_time = cache_time
        self.first = 0
        self.stamps: list[int] = []
        self.values: list[Value] = []

    def __len__(self) -> int:
        return len(self.stamps) - self.first

    @property
    def oldest(self) -> int:
        """The oldest stamp [ns]; there must be a sample."""
        return self.stamps[self.first]

    def clear(self) -> None:
        """Discard all samples."""
        self.stamps.clear()
        self.values.clear()
        self.first = 0

    def covers(self, stamp: int) -> bool:
        """Return whether `at` succeeds for this time [ns]."""
        stamps = self.stamps
        return bool(stamps) and (stamps[self.first] <= stamp <= stamps[-1] or stamp == LATEST)

    def insert(self, stamp: int, value: Value) -> bool:
        """Insert a sample, in any order; all transforms with the same stamp are kept, as by tf2.

        Returns:
            False if the sample is older than the cache.
        """
        stamps = self.stamps
        if not stamps:
            stamps.append(stamp)
            self.values.append(value)
            return True
        oldest_allowed = stamps[-1] - self.cache_time
        # before the insertion: the last sample before a pause stays, for interpolation
        if stamps[self.first] < oldest_allowed:
            self._discard(bisect_left(stamps, oldest_allowed, self.first))
        if stamp > stamps[-1]:
            stamps.append(stamp)
            self.values.append(value)
            return True
        if stamp < oldest_allowed:
            return False
        if self._replaces and stamp == stamps[-1]:
            self.values[-1] = value
            return True
        index = bisect_right(stamps, stamp, self.first)
        if value not in self.values[bisect_left(stamps, stamp, self.first) : index]:
            stamps.insert(index, stamp)
            self.values.insert(index, value)
        return True

    def at(self, stamp: int) -> Value:
        """Return the value at `stamp` [ns]; 0 is the latest time.

        Raises:
            ExtrapolationException: the time is outside of the history.
        """
        stamps = self.stamps
        if not stamps:
            raise ExtrapolationException("there are no samples")
        if stamp == stamps[-1] or stamp == LATEST:
            return self.values[-1]
        first = self.first
        if stamp == stamps[first]:
            return self.values[first]
        after = bisect_right(stamps, stamp, first)
        if not first < after < len(stamps):
            known = f"{seconds(stamps[first])} to {seconds(stamps[-1])}"
            raise ExtrapolationException(f"{seconds(stamp)} is not within {known}")
        before = stamps[after - 1]
        if before == stamp:
            return self.values[after - 1]
        ratio = (stamp - before) / (stamps[after] - before)
        return self._between(self.values[after - 1], self.values[after], ratio)

    def _between(self, older: Value, newer: Value, ratio: float) -> Value:
        raise NotImplementedError

    def _discard(self, first: int) -> None:
        """Discard the samples before an index."""
        self.first = first
        if 2 * first > len(self.stamps):
            del self.stamps[:first]
            del self.values[:first]
            self.first = 0


class JointHistory(History[float]):
    """Positions of one joint [rad or m].

    Attributes:
        continuous: the joint has no limits: it is interpolated along the shorter direction.
    """

    __slots__ = ("continuous",)
    _replaces = True  # the latest sample: a clock at rest must not fill the memory

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        super().__init__(cache_time)
        self.continuous = False

    def _between(self, older: float, newer: float, ratio: float) -> float:
        difference = newer - older
        if self.continuous:
            difference = math.remainder(difference, math.tau)
        return older + ratio * difference


class TransformHistory(History[Sample]):
    """Transforms of one frame; between samples with two parents the older one is valid.

    Attributes:
        parent: the parent of all samples; None if there are several, or no samples.
    """

    __slots__ = ("parent",)

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        super().__init__(cache_time)
        self.parent: str | None = None

    def clear(self) -> None:
        """Discard all samples."""
        super().clear()
        self.parent = None

    def insert(self, stamp: int, value: Sample) -> bool:
        """Insert a sample; see `History.insert`."""
        if not self.stamps:
            self.parent = value[0]
        is_inserted = super().insert(stamp, value)
        if is_inserted and self.parent != value[0]:
            self.parent = None
        return is_inserted

    def parent_at(self, stamp: int) -> str | None:
        """Return the parent at this time [ns]; None if it is not known."""
        if not self.covers(stamp):
            return None
        return self.parent or self.at(stamp)[0]

    def _discard(self, first: int) -> None:
        if self.parent is None:
            values = self.values
            latest = values[-1][0]
            if all(values[index][0] == latest for index in range(first, len(values))):
                self.parent = latest
        super()._discard(first)

    def _between(self, older: Sample, newer: Sample, ratio: float) -> Sample:
        if older[0] != newer[0]:
            return older
        return older[0], older[1].interpolate(newer[1], ratio)


def seconds(stamp: int) -> str:
    """Format a stamp [ns] for a message."""
    return f"{stamp * 1e-9:.6f} s"
