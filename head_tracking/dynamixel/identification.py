"""Finds out what answers on the bus, and whether it can do what the configuration wants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import (
    ConfigurationError,
    CorruptReplyError,
    ReplyTimeoutError,
    ServoModeError,
    WrongModelError,
)
from head_tracking.dynamixel.models import servo_model_by_number
from head_tracking.dynamixel.servo_link import ServoLink


@dataclass(frozen=True, slots=True)
class ServoIdentity:
    """A servo that answered and fits its joint.

    Attributes:
        joint_name: The joint it drives.
        id: Servo id.
        model: Name of the model.
        firmware_version: Contents of its register.
        lowest: Lowest tick that configuration and servo allow.
        highest: Highest tick that configuration and servo allow.
    """

    joint_name: str
    id: int
    model: str
    firmware_version: int
    lowest: int
    highest: int


def answering(links: Sequence[ServoLink], attempts: int = 3) -> tuple[int, ...]:
    """Ping the servos one by one and return the ids that answer.

    A damaged answer counts: somebody is there.
    """
    found: list[int] = []
    for link in links:
        try:
            link.ping(retries=attempts - 1)
        except ReplyTimeoutError:
            continue
        except CorruptReplyError:
            pass
        found.append(link.id)
    return tuple(found)


def identify(link: ServoLink, joint: JointConfiguration) -> ServoIdentity:
    """Check a servo that answers pings, leave it relaxed, and return what it is.

    Raises:
        ServoModeError: It does not answer reads, or is in wheel mode.
        WrongModelError: It is another model than configured.
        ConfigurationError: Its own angle limits leave the joint no range.
        RegisterRefusedError: It does not switch torque off.
        CommunicationError: It stops answering.
    """
    table = link.model.control_table
    try:
        number, firmware = link.read(table.block("Model Number", "Firmware Version"))
    except ReplyTimeoutError as cause:
        raise ServoModeError(
            f"servo {link.id} ({joint.joint_name}) answers pings but no reads: its Status Return "
            "Level (register 16) is probably 0; set it to 2 with ROBOTIS' Dynamixel Wizard"
        ) from cause
    if number != link.model.model_number:
        raise WrongModelError(
            f"servo {link.id} ({joint.joint_name}) is {_model_name(number)}, but the "
            f"configuration says {link.model.name} ({link.model.model_number}); correct the "
            "configuration's model or id"
        )
    clockwise, counterclockwise, level = link.read(
        table.block("CW Angle Limit", "CCW Angle Limit", "Status Return Level")
    )
    link.acknowledges_writes = level >= 2
    link.set_torque(False)
    if clockwise == 0 and counterclockwise == 0:
        raise ServoModeError(
            f"servo {link.id} ({joint.joint_name}) is in wheel mode (both angle limits are 0) and "
            "has no positions; set its CW and CCW Angle Limit (registers 6 and 8), for example to "
            f"{joint.tick_range[0]} and {joint.tick_range[1]}, with ROBOTIS' Dynamixel Wizard"
        )
    lowest = max(joint.tick_range[0], clockwise)
    highest = min(joint.tick_range[1], counterclockwise)
    if lowest >= highest:
        raise ConfigurationError(
            f"{joint.joint_name}: the configuration allows ticks {joint.tick_range[0]} to "
            f"{joint.tick_range[1]}, servo {link.id} itself {clockwise} to {counterclockwise}: "
            "nothing in common; correct min and max or the servo's angle limits"
        )
    return ServoIdentity(joint.joint_name, link.id, link.model.name, firmware, lowest, highest)


def summary(identities: Sequence[ServoIdentity]) -> str:
    """Return a line such as "2 AX-12 servos: ids 1, 2"."""
    by_model: dict[str, list[int]] = {}
    for identity in identities:
        by_model.setdefault(identity.model, []).append(identity.id)
    return "; ".join(
        f"{len(ids)} {model} servo{'s' if len(ids) > 1 else ''}: "
        f"id{'s' if len(ids) > 1 else ''} {', '.join(str(servo_id) for servo_id in ids)}"
        for model, ids in by_model.items()
    )


def _model_name(number: int) -> str:
    try:
        return f"{servo_model_by_number(number).name} ({number})"
    except ConfigurationError:
        return f"a model with number {number}"
