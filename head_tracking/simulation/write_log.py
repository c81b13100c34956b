"""Log of the writes that servos accepted: goals, speeds, torque and watchdog."""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

_LOGGED: Final = frozenset(
    ("Goal Position", "Torque Enable", "Moving Speed", "Profile Velocity", "Bus Watchdog")
)  # fmt: skip


class Write(NamedTuple):
    """A write that a servo accepted.

    Attributes:
        time: ns.
        id: Id of the servo.
        goal: Goal Position after the write.
        speed: Moving Speed or Profile Velocity after the write.
        torque: Whether torque was enabled after the write.
        names: The written registers.
    """

    time: int
    id: int
    goal: int
    speed: int
    torque: bool
    names: tuple[str, ...]


class WriteLog:
    """The latest writes to registers that affect the motion.

    Args:
        keep: Maximum number of writes.

    Attributes:
        writes: Latest last.
    """

    def __init__(self, keep: int = 10_000) -> None:
        self.writes: deque[Write] = deque(maxlen=keep)

    def add(self, write: Write) -> None:
        """Add a write if it affects the motion."""
        names = tuple(name for name in write.names if name in _LOGGED)
        if names:
            self.writes.append(write._replace(names=names))

    def goals(self, servo_id: int) -> list[int]:
        """Return the goal positions that a servo accepted, oldest first."""
        return [w.goal for w in self.writes if w.id == servo_id and "Goal Position" in w.names]
