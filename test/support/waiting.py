"""Waiting for what another thread or process does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE = 10.0  # s
T = TypeVar("T")


def eventually(condition: Callable[[], bool]) -> bool:
    """Whether it becomes true before long."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def wait_for(what: Callable[[], T], patience: float = 3 * PATIENCE) -> T:
    """Polls until `what` gives something true; what it gave."""
    deadline = time.monotonic() + patience
    while not (found := what()):
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {patience} s in vain; last answer: {found!r}")
        time.sleep(0.01)
    return found
