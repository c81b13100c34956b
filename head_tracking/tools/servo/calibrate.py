"""servo calibrate: zero, range and sign of joints, by moving them by hand; writes the YAML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.exceptions import CommunicationError, ConfigurationError
from head_tracking.dynamixel.models import ServoModel
from head_tracking.dynamixel.servo import Servo
from head_tracking.tools.servo.bench import RefusedError, ToolError, Workshop, find_servo

_READINGS = 9
_SMALLEST_RANGE = 0.1  # rad


@dataclass(frozen=True, slots=True)
class Wanted:
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
    _check_twice("name", [servo.name for servo in wanted])
    _check_twice("id", [servo.id for servo in wanted])
    if output is not None:
        _check_writable(output)
        if output.exists():
            workshop.terminal.confirm(f"Replace {output}?")
    mounts: list[ServoCalibration] = []
    with workshop.port() as port:
        links = [find_servo(port, servo.id, model) for servo in wanted]
        for link in links:
            link.set_torque(False)
        for servo, link in zip(wanted, links, strict=True):
            mounts.append(_calibrate(workshop, servo, link, margin))
    text = configuration(
        [servo.name for servo in wanted], mounts, workshop.port_name, workshop.baud_rate
    )
    if output is None:
        workshop.terminal.show(text)
    else:
        try:
            output.write_text(text)
        except OSError as error:
            workshop.terminal.show(text)
            raise ToolError(
                f"cannot write {output}: {error.strerror}; what it should hold is shown instead"
            ) from error
        workshop.terminal.say(f"written to {output}")
    return 0


def _check_twice(what: str, values: Sequence[str | int]) -> None:
    for value in values:
        if values.count(value) > 1:
            raise RefusedError(
                f"{what} {value} is there {values.count(value)} times; each joint needs a name and "
                "a servo of its own"
            )


def _check_writable(output: Path) -> None:
    """Find out before the first pose whether the file can be written."""
    new = not output.exists()
    try:
        with output.open("a"):
            pass
        if new:
            output.unlink()
    except OSError as error:
        raise ToolError(
            f"cannot write {output}: {error.strerror}; choose a file in a directory that is there "
            "and that you may write to"
        ) from error


def _calibrate(workshop: Workshop, servo: Wanted, link: Servo, margin: float) -> ServoCalibration:
    workshop.terminal.say(
        f"\n{servo.name}: servo {servo.id}, {link.model.name}. It is relaxed: move it by hand."
    )
    zero = _pose(workshop, link, "Move it to its zero, where the head looks straight ahead")
    low = _pose(workshop, link, "Move it to its lowest position (pan: right; tilt: up)")
    high = _pose(workshop, link, "Move it to its highest position (pan: left; tilt: down)")
    return mount_of(servo, link.model, zero, low, high, margin)


def mount_of(
    servo: Wanted, model: ServoModel, zero: int, low: int, high: int, margin: float
) -> ServoCalibration:
    """Return how a servo is mounted, from the ticks at three poses.

    Args:
        servo: The servo.
        model: Its model.
        zero: Tick at position 0.
        low: Tick at the lowest position; above `high` for a servo that is mounted reversed.
        high: Tick at the highest position.
        margin: How far to stay away from the ends, rad.

    Raises:
        RefusedError: The poses make no sense.
    """
    span = abs(high - low) * model.radians_per_tick
    if span - 2.0 * margin < _SMALLEST_RANGE:
        raise RefusedError(
            f"{servo.name}: lowest and highest position are only {span:.2f} rad apart; was the "
            "right joint moved?"
        )
    last = model.ticks - 1
    if not all(0 <= tick <= last for tick in (zero, low, high)):
        raise RefusedError(
            f"{servo.name}: the joint's range leaves the servo's single turn (ticks 0 to {last}): "
            f"lowest {low}, zero {zero}, highest {high}. Mount the horn so that the joint's zero "
            f"is near tick {model.center}"
        )
    inward = round(margin / model.radians_per_tick) * (1 if high > low else -1)
    try:
        return ServoCalibration(servo.name, servo.id, zero, low + inward, high - inward, model)
    except ConfigurationError as error:
        raise RefusedError(
            f"{error}. Zero was at tick {zero}, lowest at {low}, highest at {high}"
        ) from error


def configuration(
    names: Sequence[str], mounts: Sequence[ServoCalibration], port_name: str, baud_rate: int
) -> str:
    """Return the servo bus's part of a configuration file such as config/head.yaml."""
    lines = [
        "# Written by `servo calibrate`.",
        "",
        "/**/servo_bus:",
        "  ros__parameters:",
        f"    port_name: {port_name}",
        f"    baud_rate: {baud_rate}",
        f"    dynamixels: [{', '.join(names)}]",
    ]
    for name, mount in zip(names, mounts, strict=True):
        motor = (
            f"{{id: {mount.id}, model: {mount.model.name}, init: {mount.init}, min: {mount.min}, "
            f"max: {mount.max}}}"
        )
        low, high = mount.position(mount.min), mount.position(mount.max)
        lines += [
            f"    {name}_controller:",
            f"      joint_name: {name}_joint",
            f"      motor: {motor}    # {low:.3f} to {high:.3f} rad",
        ]
    return "\n".join(lines) + "\n"


def _pose(workshop: Workshop, link: Servo, prompt: str) -> int:
    """Return the tick at which the joint is held when Enter is pressed."""
    workshop.terminal.wait_for_enter(f"{prompt}, and press Enter.", lambda: _reading(link))
    return round(median(link.get("Present Position") for _ in range(_READINGS)))


def _reading(link: Servo) -> str:
    try:
        return f"  tick {link.get('Present Position')}"
    except CommunicationError:
        return "  no answer"
