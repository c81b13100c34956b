"""A joint has one owner at a time: whoever may command it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping

LEASE = 1.0
"""A claim by commands alone ends when none has come for so long [s]."""

JUST_STOPPED = 0.3
"""Whoever takes joints over so shortly [s] after a stop has decided it before."""


class OwnershipError(Exception):
    """A joint belongs to somebody else, or to nobody because the head is stopped."""


class JointOwners:
    """Who may command which joint; for any thread.

    Args:
        exclusive: whether a joint belongs to one at a time; else the last command wins.
        clock: never jumps [s].

    Attributes:
        stopped: whether everybody is refused.
        on_change: called after an owner has changed, or `stopped`; by the thread that did it.
    """

    def __init__(
        self, *, exclusive: bool = True, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.stopped = False
        self.on_change: Callable[[], object] = lambda: None
        self._exclusive = exclusive
        self._clock = clock
        self._lock = threading.Lock()
        self._stopped_at = -math.inf
        self._owners: dict[str, tuple[str, float]] = {}

    def claim(self, owner: str, joints: Iterable[str], lease: float = math.inf) -> None:
        """Makes joints somebody's, all or none.

        Args:
            owner: who wants them.
            joints: which.
            lease: the claim ends after so long [s], unless it is made again.

        Raises:
            OwnershipError: one belongs to somebody else, or the head is stopped.
        """
        joints = tuple(joints)
        with self._lock:
            self.check(owner, joints)
            changed = any(not self.owns(owner, joint) for joint in joints)
            until = self._clock() + lease
            for joint in joints:
                self._owners[joint] = (owner, until)
        if changed:
            self.on_change()

    def check(self, owner: str, joints: Iterable[str]) -> None:
        """Refuses what `claim` would refuse; changes nothing."""
        if self.stopped:
            raise OwnershipError("the head is stopped; call resume, or enable what shall turn it")
        now = self._clock()
        for joint in joints:
            other, until = self._owners.get(joint, ("", 0.0))
            if self._exclusive and other not in ("", owner) and now < until:
                raise OwnershipError(
                    f"{joint} belongs to {other}; switch that off first ({other}/enable "
                    "false), or let its commands end"
                    if math.isinf(until)
                    else f"{joint} belongs to {other} as long as that sends commands"
                )

    def take_over(self, owner: str, joints: Iterable[str]) -> None:
        """Makes joints somebody's, whoever had them, and ends a stop.

        Raises:
            OwnershipError: the stop has only just come.
        """
        with self._lock:
            if self.stopped and self._clock() - self._stopped_at < JUST_STOPPED:
                raise OwnershipError(
                    "the head was stopped just now; call resume, or enable it again"
                )
            self.stopped = False
            for joint in joints:
                self._owners[joint] = (owner, math.inf)
        self.on_change()

    def release(self, owner: str) -> None:
        """Makes what belongs to somebody nobody's."""
        with self._lock:
            its = [joint for joint, (other, _) in self._owners.items() if other == owner]
            for joint in its:
                self._owners[joint] = ("", 0.0)
        if its:
            self.on_change()

    def stop(self, stopped: bool = True) -> None:
        """Takes all joints from everybody and refuses all claims, or ends that."""
        with self._lock:
            self.stopped = stopped
            if stopped:
                self._stopped_at = self._clock()
                self._owners = dict.fromkeys(self._owners, ("", 0.0))
        self.on_change()

    def owns(self, owner: str, joint: str) -> bool:
        """Whether a joint is somebody's."""
        return self._owners.get(joint, ("", 0.0))[0] == owner

    def of(self, joints: Iterable[str]) -> Mapping[str, str]:
        """Each joint's owner; empty for nobody's."""
        now = self._clock()
        with self._lock:
            found = {joint: self._owners.get(joint, ("", 0.0)) for joint in joints}
        return {joint: owner if now < until else "" for joint, (owner, until) in found.items()}
