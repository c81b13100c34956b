"""Who owns which joint, in which epoch, and whether the head is stopped: as messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from std_msgs.msg import String

from head_tracking.control import STOPPED, JointOwners

_OWNER = "owner of "


class JointControl(NamedTuple):
    """The fields of a `joint_control` message.

    Attributes:
        stopped: whether everything but `resume` is refused.
        epoch: number of STOPs so far.
        owners: each joint's owner; empty where there is none.
    """

    stopped: bool
    epoch: int
    owners: Mapping[str, str]


def owners_message(owners: Mapping[str, str]) -> String:
    """Return a joint_owners message: a line for each joint, its owner behind a colon."""
    return String(data="\n".join(f"{joint}: {owner}" for joint, owner in owners.items()))


def owners_from_message(message: String) -> dict[str, str]:
    """Return each joint's owner; empty where there is none."""
    lines = (line.partition(":") for line in message.data.splitlines())
    return {joint.strip(): owner.strip() for joint, _, owner in lines}


def control_message(owners: JointOwners, joints: Iterable[str]) -> DiagnosticStatus:
    """Return a joint_control message."""
    stopped = owners.stopped
    fields = {"stopped": str(stopped).lower(), "epoch": str(owners.epoch.value)}
    fields |= {f"{_OWNER}{joint}": owner for joint, owner in owners.of(joints).items()}
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if stopped else DiagnosticStatus.OK,
        name="joint_control",
        message=STOPPED if stopped else "commands are accepted",
        values=[KeyValue(key=key, value=value) for key, value in fields.items()],
    )


def control_from_message(message: DiagnosticStatus) -> JointControl:
    """Return the fields of a joint_control message.

    Raises:
        ValueError: one is missing or malformed.
    """
    fields = {each.key: each.value for each in message.values}
    owners = {k.removeprefix(_OWNER): v for k, v in fields.items() if k.startswith(_OWNER)}
    return JointControl(fields.get("stopped") == "true", int(fields.get("epoch", "")), owners)


def sender(name: str, epoch: int) -> str:
    """Return the `frame_id` of a command or a claim: who sends it, and in which epoch."""
    return f"{name}#{epoch}"


def sender_from(frame_id: str) -> tuple[str, int | None]:
    """Return who sent a command, and its epoch; None where it gives none."""
    name, _, epoch = frame_id.rpartition("#")
    return (name, int(epoch)) if name and epoch.isdecimal() else (frame_id, None)


def stop_report(joint: str, problem: str) -> str:
    """Return what a STOP says of a joint: confirmed, or what kept it from that."""
    return f"{joint} NOT confirmed: {problem}" if problem else f"{joint} relaxed"


def resume_report(resumed: Iterable[str]) -> str:
    """Return what `resume` answers: who goes on."""
    names = ", ".join(resumed)
    return f"{names} goes on, slowly at first" if names else "commands are accepted again"
