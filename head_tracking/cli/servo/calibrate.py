"""servo calibrate: zero, range and sign of joints, by moving them by hand; writes the YAML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import NamedTuple

from head_tracking.cli.servo.bench import Terminal, ToolError, Workshop, find_servo
from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.exceptions import CommunicationError, ConfigurationError
from head_tracking.dynamixel.models import ServoModel
from head_tracking.dynamixel.servo import Servo
from head_tracking.exceptions import RefusedError

_READINGS = 9
_SMALLEST_RANGE = 0.1  # rad
_PROMPTS = (
    "Move it to its zero, where the head looks straight ahead",
    "Move it to its lowest position (pan: right; tilt: up)",
    "Move it to its highest position (pan: left; tilt: down)",
)


class Wanted(NamedTuple):
    """A servo to calibrate.

    Attributes:
        name: As in the configuration, such as head_pan.
        id: Servo id.
    """

    name: str
    id: int


def calibrate(
    workshop: Workshop,
    wanted: Sequence[Wanted],
    model: ServoModel | None,
    *,
    output: Path | None,
    margin: float,
) -> int:
    """Ask for three poses of each joint, write the configuration and return the exit code."""
    for values in zip(*wanted, strict=True):
        if len(set(values)) < len(values):
            raise RefusedError(
                f"{', '.join(map(str, values))}: each joint needs a name and a servo of its own"
            )
    terminal = workshop.terminal
    if output is not None and output.exists():
        terminal.confirm(f"Replace {output}?")
    mounts: list[ServoCalibration] = []
    with workshop.port() as port:
        links = [find_servo(port, servo.id, model) for servo in wanted]
        for link in links:
            link.set_torque(False)
        for servo, link in zip(wanted, links, strict=True):
            terminal.say(
                f"\n{servo.name}: servo {servo.id}, {link.model.name}. It is relaxed: move it by "
                "hand."
            )
            zero, low, high = (
                ticks_by_hand(terminal, [link], prompt)[servo.id] for prompt in _PROMPTS
            )
            mounts.append(mount_of(servo.name, link, zero, low, high, margin))
    text = configuration(mounts, workshop.port_name, workshop.baud_rate)
    if output is None:
        terminal.show(text)
        return 0
    try:
        output.write_text(text)
    except OSError as error:
        terminal.show(text)
        raise ToolError(
            f"cannot write {output}: {error.strerror}; its contents are shown instead"
        ) from error
    terminal.say(f"written to {output}")
    return 0


class Motion(NamedTuple):
    """The servo of a joint, and its tick at three poses; see `mount_of`."""

    link: Servo
    zero: int
    low: int
    high: int


def mount_of(
    name: str, link: Servo, zero: int, low: int, high: int, margin: float
) -> ServoCalibration:
    """Return how a servo is mounted, from the ticks at three poses.

    With it come the settings of the servo's memory that its ticks depend on: the bus refuses a
    servo whose offset or direction is another one later.

    Args:
        name: Of the joint, as in the configuration.
        link: The servo.
        zero: Tick at position 0.
        low: Tick at the lowest position; above `high` for a servo that is mounted reversed.
        high: Tick at the highest position.
        margin: How far to stay away from the ends, rad.

    Raises:
        RefusedError: The poses make no sense.
    """
    model = link.model
    span = abs(high - low) * model.radians_per_tick
    if span - 2.0 * margin < _SMALLEST_RANGE:
        raise RefusedError(
            f"{name}: lowest and highest position are only {span:.2f} rad apart; was the "
            "right joint moved?"
        )
    inward = round(margin / model.radians_per_tick) * (1 if high > low else -1)
    try:
        mount = ServoCalibration(name, link.id, zero, low + inward, high - inward, model)
    except ConfigurationError as error:
        raise RefusedError(
            f"{error}. Zero was at tick {zero}, lowest at {low}, highest at {high}. Mount the horn "
            f"so that the joint's zero is near tick {model.center}"
        ) from error
    return replace(
        mount,
        offset=None if model.offset is None else model.offset.counts(link.get(model.offset.name)),
        reverse=bool(link.get("Drive Mode") & 1) if "Drive Mode" in model.modes else None,
    )


def configuration(
    mounts: Iterable[ServoCalibration],
    port_name: str,
    baud_rate: int,
    program: str = "servo calibrate",
    seconds: Mapping[str, ServoCalibration] = {},
) -> str:
    """Return the servo bus's part of a configuration file such as config/kinectbot.yaml.

    Args:
        mounts: Of the joints.
        port_name: Of the servos.
        baud_rate: Of them.
        program: Which writes it.
        seconds: The second servo of a joint that has two, by the joint's name.
    """
    mounts = tuple(mounts)
    lines = [
        f"# Written by `{program}`.",
        "",
        "/**/servo_bus:",
        "  ros__parameters:",
        f"    port_name: {port_name}",
        f"    baud_rate: {baud_rate}",
        f"    dynamixels: [{', '.join(mount.joint_name for mount in mounts)}]",
    ]
    for mount in mounts:
        name = mount.joint_name
        low, high = mount.position(mount.min), mount.position(mount.max)
        motor = f"model: {mount.model.name}, {_values(mount)}"
        lines += [
            f"    {name}_controller:",
            f"      joint_name: {name}_joint",
            f"      motor: {{{motor}}}    # {low:.3f} to {high:.3f} rad",
        ]
        if name in seconds:
            lines.append(f"      second_motor: {{{_values(seconds[name])}}}")
    return "\n".join(lines) + "\n"


def _values(mount: ServoCalibration) -> str:
    text = f"id: {mount.id}, init: {mount.init}, min: {mount.min}, max: {mount.max}"
    text += "" if mount.offset is None else f", offset: {mount.offset}"
    return text + ("" if mount.reverse is None else f", reverse: {int(mount.reverse)}")


def ticks_by_hand(terminal: Terminal, links: Sequence[Servo], prompt: str) -> dict[int, int]:
    """Return, by id, the ticks at which servos are held when Enter is pressed."""

    def read(link: Servo) -> str:
        try:
            return f"  servo {link.id}: {link.get('Present Position')}"
        except CommunicationError:
            return f"  servo {link.id}: no answer"

    terminal.wait_for_enter(f"{prompt}, and press Enter.", lambda: " ".join(map(read, links)))
    return {
        link.id: round(median(link.get("Present Position") for _ in range(_READINGS)))
        for link in links
    }
