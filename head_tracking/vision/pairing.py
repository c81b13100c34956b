"""Pictures and depth images of the same moment."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

P = TypeVar("P")
D = TypeVar("D")

_KEPT = 6


class Pairing(Generic[P, D]):
    """Puts pictures and depth images together by their stamps; both can come first.

    Args:
        tolerance: stamps that differ by no more are of the same moment [ns].

    Attributes:
        dropped: how many pictures went without a depth image since the last pair.
    """

    def __init__(self, tolerance: int) -> None:
        self._tolerance = tolerance
        self._pictures: deque[tuple[int, P]] = deque(maxlen=_KEPT)
        self._depths: deque[tuple[int, D]] = deque(maxlen=_KEPT)
        self.dropped = 0

    def picture(self, stamp: int, picture: P) -> tuple[P, D] | None:
        """Takes a picture; the pair that it completes."""
        self._pictures.append((stamp, picture))
        return self._match()

    def depth(self, stamp: int, depth: D) -> tuple[P, D] | None:
        """Takes a depth image; the pair that it completes."""
        self._depths.append((stamp, depth))
        return self._match()

    def _match(self) -> tuple[P, D] | None:
        """The newest pair; what came before it is dropped."""
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
            # the newest one still waits for its depth; is an older one complete?
            newest = self._pictures.pop()
            pair = self._match()
            if pair is None:
                self.dropped += 1
                self._pictures.clear()
            self._pictures.append(newest)
            return pair
        return None
