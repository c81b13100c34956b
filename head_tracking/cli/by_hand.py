"""Zero, range and direction of joints that are moved by hand, and their parameter file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from statistics import median
from typing import Any, NamedTuple

import yaml

from head_tracking.cli.terminal import Terminal
from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.exceptions import CommunicationError, ConfigurationError
from head_tracking.dynamixel.servo import Servo
from head_tracking.exceptions import RefusedError

_READINGS = 9
_SMALLEST_RANGE = 0.1  # rad


def relax_for_hand(terminal: Terminal, servos: Sequence[Servo]) -> None:
    """Switch torque off after a question, so that the servos can be moved by hand."""
    held = [servo for servo in servos if servo.get("Torque Enable")]
    if held:
        ids = ", ".join(str(servo.id) for servo in held)
        terminal.confirm(f"Switch the torque of servo {ids} off? Hold the head: it may drop.")
        for servo in held:
            servo.set("Torque Enable", 0)


class ServoPoses(NamedTuple):
    """The servo of a joint, and its tick at three poses.

    Attributes:
        low: tick at the lowest position; above `high` for a servo mounted in reverse.
        high: tick at the highest position.
    """

    servo: Servo
    zero: int
    low: int
    high: int


def calibration_of(name: str, motion: ServoPoses, margin: float) -> ServoCalibration:
    """Return the calibration of a servo from its ticks at three poses.

    It includes offset and direction in the servo's memory; the bus refuses a servo with others. The
    limits are `margin` [rad] inside the lowest and highest pose.

    Raises:
        RefusedError: the poses are not possible.
    """
    servo, zero, low, high = motion
    model = servo.model
    span = abs(high - low) * model.radians_per_tick
    if span - 2.0 * margin < _SMALLEST_RANGE:
        raise RefusedError(
            f"{name}: lowest and highest position are only {span:.2f} rad apart; was the "
            "right joint moved?"
        )
    inward = round(margin / model.radians_per_tick) * (1 if high > low else -1)
    try:
        calibration = ServoCalibration(name, servo.id, zero, low + inward, high - inward, model)
    except ConfigurationError as error:
        raise RefusedError(
            f"{error}. Zero was at tick {zero}, lowest at {low}, highest at {high}. Mount the horn "
            f"so that the joint's zero is near tick {model.center}"
        ) from error
    return replace(
        calibration,
        offset=None if model.offset is None else model.offset.counts(servo.get(model.offset.name)),
        reverse=bool(servo.get("Drive Mode") & 1) if "Drive Mode" in model.modes else None,
    )


def configuration(
    joints: Sequence[Sequence[ServoCalibration]], port_name: str, baud_rate: int, program: str
) -> str:
    """Return the parameters of servo_bus as YAML; each joint has one servo or two."""
    names = [first.joint_name for first, *_ in joints]
    values: dict[str, Any] = {"port_name": port_name, "baud_rate": baud_rate, "dynamixels": names}
    for name, (first, *others) in zip(names, joints, strict=True):
        motor = {"model": first.model.name, **_values(first)}
        controller: dict[str, Any] = {"joint_name": f"{name}_joint", "motor": motor}
        if others:
            controller["second_motor"] = _values(others[0])
        values[f"{name}_controller"] = controller
    text = yaml.safe_dump({"/**/servo_bus": {"ros__parameters": values}}, sort_keys=False)
    return f"# Written by `{program}`.\n\n{text}"


def _values(servo: ServoCalibration) -> dict[str, int]:
    values = {"id": servo.id, "init": servo.init, "min": servo.min, "max": servo.max}
    memory = {"offset": servo.offset, "reverse": servo.reverse}
    return values | {name: int(value) for name, value in memory.items() if value is not None}


def ticks_by_hand(terminal: Terminal, servos: Sequence[Servo], prompt: str) -> dict[int, int]:
    """Return the ticks of servos by id at the moment when Enter is pressed."""

    def read(servo: Servo) -> str:
        try:
            return f"  servo {servo.id}: {servo.get('Present Position')}"
        except CommunicationError:
            return f"  servo {servo.id}: no answer"

    terminal.wait_for_enter(f"{prompt}, and press Enter.", lambda: " ".join(map(read, servos)))
    return {
        servo.id: round(median(servo.get("Present Position") for _ in range(_READINGS)))
        for servo in servos
    }
