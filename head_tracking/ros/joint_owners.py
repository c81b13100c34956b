"""Who owns which joint, and what came of a stop, for others."""

from __future__ import annotations

from collections.abc import Mapping

from std_msgs.msg import String


def owners_message(owners: Mapping[str, str]) -> String:
    """A joint_owners message: a line for each joint, its owner behind a colon."""
    return String(data="\n".join(f"{joint}: {owner}" for joint, owner in owners.items()))


def owners_from_message(message: String) -> dict[str, str]:
    """Each joint's owner; empty for nobody's."""
    lines = (line.partition(":") for line in message.data.splitlines())
    return {joint.strip(): owner.strip() for joint, _, owner in lines}


def stop_report(joint: str, problem: str) -> str:
    """What a stop says of a joint: that its servos have confirmed, or what kept them from it."""
    return f"{joint} NOT confirmed: {problem}" if problem else f"{joint} relaxed"
