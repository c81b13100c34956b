"""The owners of joints, and STOP."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

from head_tracking.dynamixel import Epoch, StoppedError

_T = TypeVar("_T")

LEASE = 1.0
"""Time without commands after which a claim by commands ends [s]."""

STOPPED = "the head is stopped; call resume"
"""The error message of everything that is refused after a STOP."""

_OVERTAKEN = "the head was stopped after this was requested"


class OwnershipError(Exception):
    """A joint belongs to another owner.

    Attributes:
        leased: whether its claim ends when it sends no more commands.
    """

    def __init__(self, joint: str, owner: str, sender: str, leased: bool) -> None:
        remedy = (
            "the sender is another node of the same name: rename it (-r __node:=...), or end it"
            if sender == owner
            else f"wait until it has sent no command for {LEASE:g} s"
            if leased
            else f"disable it first ({owner}/enable false)"
        )
        super().__init__(f"{joint} belongs to {owner}; {remedy}")
        self.joint, self.owner, self.leased = joint, owner, leased


class JointOwners:
    """Owners of joints, and whether the head is stopped; for any thread.

    A controller owns its joints until it releases them. A sender of commands owns them while it
    sends (a lease); it must not have the name of a controller. During a STOP nobody owns a joint;
    `resume` gives them back to controllers.

    A request or a goal carries the epoch in which it was made, from `permit` or `check`.

    Args:
        clock: monotonic time [s].
        exclusive: refuse commands for a joint of another owner; else the last command wins.

    Attributes:
        stopped: whether everything but `resume` is refused.
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, *, exclusive: bool = True
    ) -> None:
        self.epoch = Epoch()
        self.stopped = False
        self._clock = clock
        self._exclusive = exclusive
        self._lock = threading.RLock()  # a signal handler may stop the head meanwhile
        self._owners: dict[str, tuple[str, float]] = {}
        self._elsewhere: dict[str, str] = {}
        self._observers: list[Callable[[], object]] = []

    def observe(self, changed: Callable[[], object]) -> None:
        """Call a function after each change of an owner or of `stopped`, in the changing thread."""
        self._observers.append(changed)

    def permit(self, epoch: int | None = None) -> int:
        """Return the epoch of a request that was made in `epoch`; None: now.

        Raises:
            StoppedError: the head is stopped, or was after the request was made.
        """
        with self._lock:
            if self.stopped:
                raise StoppedError(STOPPED)
            if epoch not in (None, self.epoch.value):
                raise StoppedError(_OVERTAKEN)
            return self.epoch.value

    def check(self, owner: str, joints: Iterable[str], epoch: int | None = None) -> int:
        """Return the epoch of a command for joints; raise what `claim` would raise.

        Raises:
            OwnershipError: one belongs to another owner.
            StoppedError: the head is stopped, or was after the command was made.
        """
        joints = tuple(joints)
        with self._lock:
            now = self.permit(epoch)
            self._check(owner, joints, LEASE)
            return now

    def claim(self, owner: str, joints: Iterable[str], lease: float = math.inf) -> None:
        """Give joints to an owner, all or none, for `lease` seconds unless it claims them again.

        What a controller claims during a STOP, it gets from `resume`, unless another one had it.

        Raises:
            OwnershipError: one belongs to another owner.
            StoppedError: the head is stopped.
        """
        joints = tuple(joints)
        with self._lock:
            if self.stopped and math.isinf(lease) and not self._owners.keys() & set(joints):
                self._owners |= dict.fromkeys(joints, (owner, lease))
            self.permit()
            self._check(owner, joints, lease)
            before = {joint: self._owners.get(joint, ("", 0.0)) for joint in joints}
            given = [
                j for j, (other, until) in before.items() if other == owner or until < math.inf
            ]
            changed = any(before[joint][0] != owner for joint in given)
            self._owners |= dict.fromkeys(given, (owner, self._clock() + lease))
        if changed:
            self._notify()

    def take_over(
        self, owner: str, joints: Iterable[str], epoch: int | None = None, lease: float = math.inf
    ) -> None:
        """Give joints to an owner for `lease` seconds, whoever had them.

        Raises:
            OwnershipError: a controller of the same name owns one.
            StoppedError: the head is stopped, or was after `epoch`, in which this was requested.
        """
        joints = tuple(joints)
        with self._lock:
            self.permit(epoch)
            self._refuse_namesake(owner, joints, lease)
            for joint in joints:
                self._owners[joint] = (owner, self._clock() + lease)
        self._notify()

    def release(self, owner: str) -> None:
        """Take all joints from an owner, including those that `resume` would give back."""
        with self._lock:
            self._owners = {j: each for j, each in self._owners.items() if each[0] != owner}
        self._notify()

    def stop(self, relax: Callable[[], _T]) -> _T:
        """STOP: refuse everything, relax the servos, then notify the observers.

        Args:
            relax: relaxes the servos without waiting for a controller; its result is returned.
        """
        with self._lock:
            self.epoch.advance()
            self._stop()
        try:
            return relax()
        finally:
            self._notify()

    def resume(self, epoch: int | None = None) -> tuple[str, ...]:
        """End a STOP and return the owners that have their joints back.

        Raises:
            StoppedError: there was another STOP since `epoch`, in which this was requested.
        """
        with self._lock:
            if epoch not in (None, self.epoch.value):
                raise StoppedError(_OVERTAKEN)
            resumed = dict.fromkeys(owner for owner, _ in self._owners.values())
            was_stopped, self.stopped = self.stopped, False
        self._notify()
        return tuple(resumed) if was_stopped else ()

    def follow(self, stopped: bool, epoch: int, owners: Mapping[str, str] | None = None) -> bool:
        """Adopt the state of a servo bus in another process; return whether it knows our STOP.

        A servo bus that was restarted does not know it, and must be stopped again.

        Args:
            stopped: whether the servo bus is stopped.
            epoch: number of its STOPs.
            owners: of its joints. An owner that loses a joint there loses it here, also if it is
                another one that gets it back at the end of a STOP.
        """
        with self._lock:
            if self.stopped and not stopped and epoch != self.epoch.value:
                return False
            before, self._elsewhere = self._elsewhere, dict(owners or {})
            changed = (stopped, epoch) != (self.stopped, self.epoch.value)
            self.epoch.value = epoch
            if changed and stopped:
                self._stop()
            self.stopped = stopped
            for joint, other in self._elsewhere.items():
                owner, _ = self._owners.get(joint, ("", 0.0))
                known = owner if changed else before.get(joint)  # a claim may be on its way
                if owner and other and owner == known != other:
                    self._owners[joint] = other, math.inf
                    changed = True
        if changed:
            self._notify()
        return True

    def elsewhere(self, joints: Iterable[str]) -> str:
        """Return the owner of one of these joints at a servo bus elsewhere; empty: none."""
        return next(filter(None, map(self._elsewhere.get, joints)), "")

    def owns(self, owner: str, joints: Iterable[str]) -> bool:
        """Return whether all these joints belong to an owner."""
        owners = {} if self.stopped else self._owners
        return all([owners.get(joint, ("", 0.0))[0] == owner for joint in joints])

    def of(self, joints: Iterable[str]) -> Mapping[str, str]:
        """Return the owner of each joint; empty: none."""
        now = self._clock()
        with self._lock:
            owners = {} if self.stopped else self._owners
            found = {joint: owners.get(joint, ("", 0.0)) for joint in joints}
        return {joint: owner if now < until else "" for joint, (owner, until) in found.items()}

    def _notify(self) -> None:
        for changed in self._observers:
            changed()

    # with the lock held

    def _check(self, owner: str, joints: Iterable[str], lease: float) -> None:
        self._refuse_namesake(owner, joints, lease)
        now = self._clock()
        for joint in joints:
            other, until = self._owners.get(joint, ("", 0.0))
            both_control = math.isinf(until) and math.isinf(lease)
            if other != owner and now < until and (self._exclusive or both_control):
                raise OwnershipError(joint, other, owner, leased=math.isfinite(until))

    def _refuse_namesake(self, sender: str, joints: Iterable[str], lease: float) -> None:
        """Refuse a sender of commands with the name of a controller, which it would replace."""
        for joint in joints:
            if math.isfinite(lease) and self._owners.get(joint) == (sender, math.inf):
                raise OwnershipError(joint, sender, sender, leased=False)

    def _stop(self) -> None:
        self.stopped = True
        self._owners = {j: each for j, each in self._owners.items() if math.isinf(each[1])}
