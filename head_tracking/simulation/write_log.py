"""What has really reached the servos: every goal, every speed and every switch, in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple, Protocol

_WATCHED: Final = frozenset(
    ("Goal Position", "Torque Enable", "Moving Speed", "Profile Velocity", "Goal Velocity",
     "Bus Watchdog")
)  # fmt: skip


class Watched(Protocol):
    """The registers of a servo."""

    @property
    def goal_speed(self) -> int:
        """Speed at which a goal is approached, in the servo's counts."""

    def __getitem__(self, name: str) -> int: ...


class Write(NamedTuple):
    """Something that a servo took from a packet.

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


class WriteLog:
    """Keeps every goal, speed and switch of torque and watchdog that servos took from packets.

    Args:
        keep: How many it keeps at most; the oldest are forgotten first.

    Attributes:
        writes: Newest last.
    """

    def __init__(self, keep: int = 10_000) -> None:
        self.writes: deque[Write] = deque(maxlen=keep)

    def note(self, time: int, servo_id: int, registers: Watched, names: Iterable[str]) -> None:
        """Keep a write, if it has to do with motion."""
        told = tuple(name for name in names if name in _WATCHED)
        if told:
            goal, torque = registers["Goal Position"], bool(registers["Torque Enable"])
            self.writes.append(Write(time, servo_id, goal, registers.goal_speed, torque, told))

    def goals(self, servo_id: int) -> list[int]:
        """Return the goal positions that a servo took, oldest first."""
        return [w.goal for w in self.writes if w.id == servo_id and "Goal Position" in w.names]
