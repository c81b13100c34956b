"""Samples over time by the rules of tf2's TimeCache: interpolated between, never extrapolated."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from typing import Generic, TypeAlias, TypeVar

from head_tracking.transforms.exceptions import ExtrapolationException
from head_tracking.transforms.transform import Transform

DEFAULT_CACHE_TIME = 10_000_000_000  # 10 s in ns, tf2's default

LATEST = 0
"""tf2: the time zero asks for the latest time."""

Sample: TypeAlias = tuple[str, Transform]
"""A parent, and the transform in it: `T_parent_child`."""

Value = TypeVar("Value")


class History(Generic[Value]):
    """Samples of one quantity.

    Attributes:
        stamps: when the samples were taken [ns], sorted; the last one is the newest. What stands
            before `first` is forgotten, and taken out now and then: a list gives away its front at
            the price of moving all the rest.
        values: the samples.
        first: the index of the oldest sample.
        cache_time: how much older than the newest a sample may be [ns].
    """

    __slots__ = ("cache_time", "first", "stamps", "values")

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
        """Forget everything."""
        self.stamps.clear()
        self.values.clear()
        self.first = 0

    def covers(self, stamp: int) -> bool:
        """Whether `at` has an answer for this time [ns]."""
        stamps = self.stamps
        return bool(stamps) and (stamps[self.first] <= stamp <= stamps[-1] or stamp == LATEST)

    def insert(self, stamp: int, value: Value) -> bool:
        """Takes a sample, also one that comes late; those with one stamp are all kept.

        Returns:
            False if the sample is older than the cache and was not taken.
        """
        stamps = self.stamps
        if not stamps:
            stamps.append(stamp)
            self.values.append(value)
            return True
        oldest_allowed = stamps[-1] - self.cache_time
        # before the new sample comes: the last one before a pause stays, to interpolate from
        if stamps[self.first] < oldest_allowed:
            self._forget(bisect_left(stamps, oldest_allowed, self.first))
        if stamp > stamps[-1]:
            stamps.append(stamp)
            self.values.append(value)
            return True
        if stamp < oldest_allowed:
            return False
        index = bisect_right(stamps, stamp, self.first)
        if value not in self.values[bisect_left(stamps, stamp, self.first) : index]:
            stamps.insert(index, stamp)
            self.values.insert(index, value)
        return True

    def at(self, stamp: int) -> Value:
        """The value at `stamp` [ns], or the newest.

        Raises:
            ExtrapolationException: nothing is known of that time.
        """
        stamps = self.stamps
        if not stamps:
            raise ExtrapolationException("nothing is known")
        if stamp == stamps[-1] or stamp == LATEST:
            return self.values[-1]
        first = self.first
        if stamp == stamps[first]:
            return self.values[first]
        after = bisect_right(stamps, stamp, first)
        if not first < after < len(stamps):
            raise ExtrapolationException(
                f"extrapolation into the {'future' if after > first else 'past'}: time "
                f"{seconds(stamp)} was asked for, {seconds(stamps[first])} to "
                f"{seconds(stamps[-1])} is known"
            )
        before = stamps[after - 1]
        if before == stamp:
            return self.values[after - 1]
        ratio = (stamp - before) / (stamps[after] - before)
        return self._between(self.values[after - 1], self.values[after], ratio)

    def _between(self, older: Value, newer: Value, ratio: float) -> Value:
        raise NotImplementedError

    def _forget(self, first: int) -> None:
        """Forget the samples before the index `first`."""
        self.first = first
        if 2 * first > len(self.stamps):
            del self.stamps[:first]
            del self.values[:first]
            self.first = 0


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

    def _between(self, older: float, newer: float, ratio: float) -> float:
        difference = newer - older
        if self.continuous:
            difference = math.remainder(difference, math.tau)
        return older + ratio * difference


class TransformHistory(History[Sample]):
    """Transforms of one frame; between samples in two parents the older one holds.

    Attributes:
        parent: the parent of all samples; None if they have several or there is none.
    """

    __slots__ = ("parent",)

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        super().__init__(cache_time)
        self.parent: str | None = None

    def clear(self) -> None:
        """Forget everything."""
        super().clear()
        self.parent = None

    def insert(self, stamp: int, value: Sample) -> bool:
        """As for any history."""
        if not self.stamps:
            self.parent = value[0]
        taken = super().insert(stamp, value)
        if taken and self.parent != value[0]:
            self.parent = None
        return taken

    def parent_at(self, stamp: int) -> str | None:
        """The parent at this time [ns]; None if it is not known."""
        if not self.covers(stamp):
            return None
        return self.parent or self.at(stamp)[0]

    def _forget(self, first: int) -> None:
        if self.parent is None:
            values = self.values
            newest = values[-1][0]
            if all(values[index][0] == newest for index in range(first, len(values))):
                self.parent = newest
        super()._forget(first)

    def _between(self, older: Sample, newer: Sample, ratio: float) -> Sample:
        if older[0] != newer[0]:
            return older
        return older[0], older[1].interpolate(newer[1], ratio)


def seconds(stamp: int) -> str:
    """A stamp [ns] for a person to read."""
    return f"{stamp * 1e-9:.6f} s"
