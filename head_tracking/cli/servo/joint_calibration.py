"""servo calibrate: measures zero, range and direction of joints moved by hand; writes YAML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

import yaml

from head_tracking.cli.servo.session import Session, find_servo
from head_tracking.cli.terminal import Terminal
from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.exceptions import CommunicationError, ConfigurationError
from head_tracking.dynamixel.servo import Servo
from head_tracking.exceptions import RefusedError
from head_tracking.share import write_file

T = TypeVar("T")
Ticks = dict[int, int]
"""The position of each servo, by id."""

_READINGS = 9
_SMALLEST_RANGE = 0.1  # rad
_PROMPTS = (
    "Move it to its zero, with the head straight ahead",
    "Move it to its lowest position (pan: right; tilt: up)",
    "Move it to its highest position (pan: left; tilt: down)",
)


def calibrate(
    session: Session, named: Sequence[tuple[str, int]], *, output: Path | None, margin: float
) -> None:
    """Ask for three poses of each joint, and write the configuration; without a file print it.

    It is printed also if the file cannot be written. `named` is the name in the configuration and
    the id of each servo. The limits have a `margin` from the lowest and highest pose [rad].
    """
    for values in zip(*named, strict=True):
        if len(set(values)) < len(values):
            raise RefusedError(
                f"{', '.join(map(str, values))}: each joint needs a name and a servo of its own"
            )
    terminal = session.terminal
    if output is not None and output.exists():
        terminal.confirm(f"Replace {output}?")
    calibrations: list[ServoCalibration] = []
    with session.port() as port:
        servos = [find_servo(port, servo_id, session.model) for _, servo_id in named]
        relax_for_hand(terminal, servos)
        for (name, servo_id), servo in zip(named, servos, strict=True):
            terminal.print(f"\n{name}: servo {servo_id}, {servo.model.name}")
            calibrated = partial(_calibrated, name, servo, margin)
            calibrations.append(by_hand(terminal, [servo], name, _PROMPTS, calibrated))
    text = configuration(
        [[each] for each in calibrations], session.port_name, session.baud_rate, "servo calibrate"
    )
    if output is None:
        return terminal.show(text)
    try:
        write_file(output, text)
    except OSError:  # such as a full disk
        terminal.show(text)
        raise
    terminal.print(f"written: {output}")


def _calibrated(name: str, servo: Servo, margin: float, *poses: Ticks) -> ServoCalibration:
    return calibration_of(name, servo, [pose[servo.id] for pose in poses], margin)


def relax_for_hand(terminal: Terminal, servos: Sequence[Servo]) -> None:
    """Switch torque off after a question, so that the servos can be moved by hand."""
    held = [servo for servo in servos if servo.get("Torque Enable")]
    if held:
        ids = ", ".join(str(servo.id) for servo in held)
        terminal.confirm(f"Switch the torque of servo {ids} off? Hold the head: it may drop.")
        for servo in held:
            servo.set("Torque Enable", 0)


def calibration_of(
    name: str, servo: Servo, ticks: Sequence[int], margin: float
) -> ServoCalibration:
    """Return the calibration of a servo with offset and direction in its memory.

    The bus refuses a servo with others.

    Args:
        name: of the joint.
        servo: the servo.
        ticks: at zero, at the lowest and at the highest position of the joint.
        margin: distance of the limits from the lowest and highest position [rad].

    Raises:
        RefusedError: the positions are not possible.
    """
    (zero, low, high), model = ticks, servo.model
    span = abs(high - low) * model.radians_per_tick
    if span - 2.0 * margin < _SMALLEST_RANGE:
        raise RefusedError(
            f"{name}: lowest and highest position are only {span:.2f} rad apart; turn servo "
            f"{servo.id} by hand to both ends"
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


def by_hand(
    terminal: Terminal,
    servos: Sequence[Servo],
    joint: str,
    prompts: Sequence[str],
    calibrated: Callable[..., T],
) -> T:
    """Return what `calibrated` makes of a joint's poses; ask again for impossible ones.

    It gets the ticks of each pose and raises RefusedError if they are not possible.
    """
    while True:
        poses = [_ticks_by_hand(terminal, servos, prompt) for prompt in prompts]
        for servo in servos:  # relaxed X servos count turns, and forget them with torque on
            turns = poses[0][servo.id] // servo.model.ticks * servo.model.ticks
            for pose in poses:
                pose[servo.id] -= turns
        try:
            return calibrated(*poses)
        except RefusedError as error:
            terminal.print(f"{error}. Move {joint} again, or press Ctrl-C")


def _ticks_by_hand(terminal: Terminal, servos: Sequence[Servo], prompt: str) -> Ticks:
    """Return the ticks of servos by id at the moment when Enter is pressed."""

    def read(servo: Servo) -> str:
        try:
            return f"  servo {servo.id}: {servo.get('Present Position')}"
        except CommunicationError:
            return f"  servo {servo.id}: no answer"

    while True:
        terminal.wait_for_enter(f"{prompt}, and press Enter.", lambda: " ".join(map(read, servos)))
        try:
            return {
                servo.id: round(median(servo.get("Present Position") for _ in range(_READINGS)))
                for servo in servos
            }
        except CommunicationError as error:  # such as a plug that is loose
            terminal.print(f"{error}: check its plug")
