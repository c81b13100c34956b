"""What keeps a head from moving: a code, a fact, and the sentence for logs and states."""

from __future__ import annotations

from dataclasses import dataclass

from head_tracking.compatibility import StrEnum
from head_tracking.control.owners import STOPPED


class Reason(StrEnum):
    """Why a head does not move."""

    STOPPED = "stopped"
    RELAXED = "relaxed"
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
    Reason.STOPPED: STOPPED,
    Reason.RELAXED: "the head is relaxed",
    Reason.CLOSED: "the head is closed",
    Reason.DISABLED: "{} is disabled",
    Reason.OWNED: "the joints belong to {}",
    Reason.LOST: "{} has taken over the head",
    Reason.FAULT: "{}",
    Reason.NO_MODEL: "waiting for robot_description",
    Reason.INVALID_MODEL: "robot_description cannot be used: {}",
    Reason.CLOCK: "{}",
    Reason.NOT_MEASURED: "no recent position of {}: its servo or joint_states are silent",
    Reason.FUTURE: "the positions of {} in joint_states have stamps in the future: the clocks of "
    "their sender and of this machine differ",
}


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Why a head does not move.

    Attributes:
        reason: the kind.
        detail: the joint, the owner or the error that it is about; empty: none.
    """

    reason: Reason
    detail: str = ""

    def __str__(self) -> str:
        return _SENTENCES[self.reason].format(self.detail)
