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
        dropped: number of images without a depth image since the last pair.
    """

    def __init__(self, tolerance: int) -> None:
        self._tolerance = tolerance
        self._pictures: deque[tuple[int, P]] = deque(maxlen=_KEPT)
        self._depths: deque[tuple[int, D]] = deque(maxlen=_KEPT)
        self.dropped = 0

    def picture(self, stamp: int, picture: P) -> tuple[P, D] | None:
        """Add an image; return the pair that it completes, if any."""
        self._pictures.append((stamp, picture))
        return self._match()

    def depth(self, stamp: int, depth: D) -> tuple[P, D] | None:
        """Add a depth image; return the pair that it completes, if any."""
        self._depths.append((stamp, depth))
        return self._match()

    def _match(self) -> tuple[P, D] | None:
        """Return the latest pair; discard what is older."""
        while self._pictures:
            stamp, picture = self._pictures[-1]
            near = min(self._depths, key=lambda item: abs(item[0] - stamp), default=None)
            if near is not None and abs(near[0] - stamp) <= self._tolerance:
                self._pictures.clear()
                while self._depths and self._depths[0][0] <= near[0]:
                    self._depths.popleft()
                self.dropped = 0
                return picture, near[1]
            if len(self._pictures) == 1:
                return None
            # the latest image still waits for its depth; an older one may be complete
            latest = self._pictures.pop()
            pair = self._match()
            if pair is None:
                self.dropped += 1
                self._pictures.clear()
            self._pictures.append(latest)
            return pair
        return None
