"""What keeps a head from moving: a code, a fact, and the sentence for logs and states."""

from __future__ import annotations

from dataclasses import dataclass

from head_tracking.compatibility import StrEnum
from head_tracking.control.owners import STOPPED


class Blocked(StrEnum):
    """Why a head does not move."""

    STOPPED = "stopped"
    CLOSED = "closed"
    DISABLED = "disabled"
    OWNED = "owned by another controller"
    LOST = "taken over"
    FAULT = "fault"
    NO_MODEL = "no model"
    INVALID_MODEL = "invalid model"
    CLOCK = "no clock"
    NOT_MEASURED = "not measured"
    FUTURE = "measured in the future"


_SENTENCES = {
    Blocked.STOPPED: STOPPED,
    Blocked.CLOSED: "the head is closed",
    Blocked.DISABLED: "{} is disabled",
    Blocked.OWNED: "the joints belong to {}",
    Blocked.LOST: "{} has taken over the head",
    Blocked.FAULT: "{}",
    Blocked.NO_MODEL: "waiting for robot_description",
    Blocked.INVALID_MODEL: "robot_description cannot be used: {}",
    Blocked.CLOCK: "{}",
    Blocked.NOT_MEASURED: "no recent position of {}: its servo or joint_states are silent, or "
    "stamped by another clock",
    Blocked.FUTURE: "the positions of {} in joint_states have stamps in the future: the clocks of "
    "their sender and of this machine differ",
}


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Why a head does not move.

    Attributes:
        reason: the kind.
        detail: the joint, the owner or the error that it is about; empty: none.
    """

    reason: Blocked
    detail: str = ""

    def __str__(self) -> str:
        return _SENTENCES[self.reason].format(self.detail)
