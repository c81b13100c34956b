"""Match images and depth images by their stamps."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

P = TypeVar("P")
D = TypeVar("D")

_KEPT = 6


class Pairing(Generic[P, D]):
    """Matches images and depth images that arrive in any order.

    Args:
        tolerance: maximum difference of the stamps [ns].

    Attributes:
        dropped: number of images that waited in vain since the last pair.
    """

    def __init__(self, tolerance: int) -> None:
        self._tolerance = tolerance
        self._pictures: deque[tuple[int, P]] = deque(maxlen=_KEPT)
        self._depths: deque[tuple[int, D]] = deque(maxlen=_KEPT)
        self.dropped = 0

    def picture(self, stamp: int, picture: P) -> tuple[P, D] | None:
        """Add an image; return the pair that it completes, if any."""
        self.dropped += len(self._pictures) == _KEPT
        self._pictures.append((stamp, picture))
        return self._match()

    def depth(self, stamp: int, depth: D) -> tuple[P, D] | None:
        """Add a depth image; return the pair that it completes, if any."""
        self._depths.append((stamp, depth))
        return self._match()

    def _match(self) -> tuple[P, D] | None:
        """Return the latest pair; discard what is older."""
        for number, (stamp, picture) in reversed(list(enumerate(self._pictures))):
            ages = [abs(other - stamp) for other, _ in self._depths]
            if ages and min(ages) <= self._tolerance:
                near, depth = self._depths[ages.index(min(ages))]
                for _ in range(number + 1):
                    self._pictures.popleft()
                while self._depths and self._depths[0][0] <= near:
                    self._depths.popleft()
                self.dropped = 0
                return picture, depth
        latest = self._depths[-1][0] if self._depths else 0
        while self._pictures and self._pictures[0][0] < latest - self._tolerance:
            self._pictures.popleft()
            self.dropped += 1
        return None
