"""What has really reached the servos: every goal and every speed, in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from head_tracking.simulation.servo_body import ServoBody

_SPEEDS: Final = ("Moving Speed", "Profile Velocity", "Goal Velocity")
_WATCHED: Final = frozenset(("Goal Position", "Torque Enable", *_SPEEDS))


class Taken(NamedTuple):
    """A goal or a speed that a servo has taken.

    Attributes:
        time: ns.
        id: The servo.
        goal: Goal Position after the write.
        speed: Moving Speed or Profile Velocity after the write; Goal Velocity in velocity mode.
        torque: Whether torque was on after the write.
        names: The registers that were written.
    """

    time: int
    id: int
    goal: int
    speed: int
    torque: bool
    names: tuple[str, ...]


class Oracle:
    """Keeps every goal, speed and switch of torque that servos took from packets.

    Args:
        keep: How many it keeps at most; the oldest are forgotten first.

    Attributes:
        taken: Newest last.
    """

    def __init__(self, keep: int = 10_000) -> None:
        self.taken: deque[Taken] = deque(maxlen=keep)

    def note(self, time: int, servo: ServoBody, names: Iterable[str]) -> None:
        """Keep a write, if it has to do with motion."""
        told = tuple(name for name in names if name in _WATCHED)
        if told:
            goal, speed, torque = servo.command
            self.taken.append(Taken(time, servo.id, goal, speed, torque, told))

    def goals(self, servo_id: int) -> list[int]:
        """Return the goal positions that a servo took, oldest first."""
        return [t.goal for t in self.taken if t.id == servo_id and "Goal Position" in t.names]
