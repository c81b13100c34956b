"""Who waits for a transform, and is woken when it can be had and not before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(eq=False, slots=True)
class Request:
    """A wish to be told once.

    Attributes:
        possible: whether the wish can be fulfilled; called with the buffer's lock held.
        callback: called when it can, without the lock.
    """

    possible: Callable[[], bool]
    callback: Callable[[], object]


class Requests:
    """Open wishes. Not thread-safe.

    Attributes:
        open: those that are neither fulfilled nor withdrawn.
    """

    def __init__(self) -> None:
        self.open: list[Request] = []

    def add(self, request: Request) -> None:
        """Keeps a wish until it is fulfilled or withdrawn."""
        self.open.append(request)

    def withdraw(self, request: Request) -> None:
        """Forgets a wish, if it is still open."""
        if request in self.open:
            self.open.remove(request)

    def take_fulfilled(self) -> list[Request]:
        """The wishes that can be fulfilled now; they are open no more."""
        fulfilled = [request for request in self.open if request.possible()]
        self.open = [request for request in self.open if request not in fulfilled]
        return fulfilled
