"""Finds out what answers on the bus, and whether it can do what the configuration wants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Final

from head_tracking.dynamixel.exceptions import (
    ConfigurationError,
    CorruptReplyError,
    ReplyTimeoutError,
    ServoModeError,
    WrongModelError,
)
from head_tracking.dynamixel.models import servo_model_by_number
from head_tracking.dynamixel.mount import ServoMount
from head_tracking.dynamixel.servo_link import ServoLink

_POSITION_MODE: Final = 3
_JOINT_MODE: Final = 2  # XL-320
_TIME_BASED: Final = 4  # bit of Drive Mode


@dataclass(frozen=True, slots=True)
class ServoIdentity:
    """A servo that answered and fits its joint.

    Attributes:
        joint_name: The joint it drives.
        id: Servo id.
        model: Name of the model.
        firmware_version: Contents of its register.
        own_range: Lowest and highest tick by the servo's own angle limits.
        shutdown: Errors upon which the servo switches itself off.
        temperature_limit: Above it the servo counts as overheated, degrees Celsius.
        powered: Whether its torque was on when it was found.
    """

    joint_name: str
    id: int
    model: str
    firmware_version: int
    own_range: tuple[int, int]
    shutdown: IntFlag
    temperature_limit: float
    powered: bool


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


def identify(link: ServoLink, mount: ServoMount, keep_torque: bool = False) -> ServoIdentity:
    """Check a servo that answers pings, leave it relaxed, and return what it is.

    Args:
        link: The servo.
        mount: What the configuration says of it.
        keep_torque: Leave its torque as it is.

    Raises:
        ServoModeError: It does not answer reads, or does not work in positions.
        WrongModelError: It is another model than configured.
        RegisterRefusedError: It does not switch torque off.
        CommunicationError: It stops answering.
    """
    table = link.model.control_table
    try:
        number = link.get("Model Number")
    except ReplyTimeoutError as cause:
        raise ServoModeError(
            f"servo {link.id} ({mount.joint_name}) answers pings but no reads: its Status Return "
            f"Level (register {table['Status Return Level'].address}) is probably 0; set it to 2, "
            f"for example with `servo set {link.id} 'Status Return Level' 2`"
        ) from cause
    if number != link.model.model_number:
        raise WrongModelError(
            f"servo {link.id} ({mount.joint_name}) is {model_name(number)}, but the "
            f"configuration says {link.model.name} ({link.model.model_number}); correct the "
            "configuration's model or id"
        )
    link.acknowledges_writes = link.get("Status Return Level") >= 2
    powered = link.get("Torque Enable") == 1
    if not keep_torque:
        link.set_torque(False)
    lower, upper = (link.get(name) for name in link.model.position_limits)
    _check_mode(link, mount, lower, upper)
    shutdown = link.get("Shutdown") & sum(link.model.errors)
    return ServoIdentity(
        mount.joint_name,
        link.id,
        link.model.name,
        link.get("Firmware Version"),
        (lower, upper),
        link.model.errors(shutdown),
        float(link.get("Temperature Limit")),
        powered,
    )


def _check_mode(link: ServoLink, mount: ServoMount, lower: int, upper: int) -> None:
    """Refuse a servo that does not go to positions, or counts speeds in another way."""
    table = link.model.control_table
    who = f"servo {link.id} ({mount.joint_name})"
    how = f"for example with `servo set {link.id} REGISTER VALUE`"
    if "Operating Mode" in table:
        mode = link.get("Operating Mode")
        if mode != _POSITION_MODE:
            raise ServoModeError(
                f"{who} is in operating mode {mode}; set Operating Mode (register "
                f"{table['Operating Mode'].address}) to {_POSITION_MODE}, position control, {how}"
            )
        if link.get("Drive Mode") & _TIME_BASED:
            raise ServoModeError(
                f"{who} takes its profile velocity as a time; clear bit 2 of Drive Mode (register "
                f"{table['Drive Mode'].address}), {how}"
            )
    elif "Control Mode" in table and link.get("Control Mode") != _JOINT_MODE:
        raise ServoModeError(
            f"{who} is in wheel mode and has no positions; set Control Mode (register "
            f"{table['Control Mode'].address}) to {_JOINT_MODE}, {how}"
        )
    elif lower == upper:
        name = "wheel mode" if lower == 0 else "multi-turn mode"
        raise ServoModeError(
            f"{who} is in {name} (both angle limits are {lower}) and has no positions within one "
            "turn; set its CW and CCW Angle Limit (registers 6 and 8), for example to "
            f"{mount.tick_range[0]} and {mount.tick_range[1]}, {how}"
        )


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


def model_name(number: int) -> str:
    """Return the name of the model with that Model Number, and the number."""
    try:
        return f"{servo_model_by_number(number).name} ({number})"
    except ConfigurationError:
        return f"a model with number {number}"
