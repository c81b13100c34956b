"""servo calibrate: measures zero, range and direction of joints moved by hand; writes YAML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from head_tracking.cli.by_hand import (
    ServoPoses,
    calibration_of,
    configuration,
    relax_for_hand,
    ticks_by_hand,
)
from head_tracking.cli.servo.session import Session, find_servo
from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.exceptions import RefusedError

_PROMPTS = (
    "Move it to its zero, with the head straight ahead",
    "Move it to its lowest position (pan: right; tilt: up)",
    "Move it to its highest position (pan: left; tilt: down)",
)


def calibrate(
    session: Session, named: Sequence[tuple[str, int]], *, output: Path | None, margin: float
) -> int:
    """Ask for three poses of each joint, write the configuration and return the exit code.

    Args:
        session: the terminal and the port.
        named: name in the configuration and id of each servo.
        output: file to write; None: print.
        margin: distance of the limits from the lowest and highest pose [rad].
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
            ticks = [ticks_by_hand(terminal, [servo], prompt)[servo_id] for prompt in _PROMPTS]
            calibrations.append(calibration_of(name, ServoPoses(servo, *ticks), margin))
    text = configuration(
        [[each] for each in calibrations], session.port_name, session.baud_rate, "servo calibrate"
    )
    if output is None:
        terminal.show(text)
    else:
        output.write_text(text)
        terminal.print(f"written: {output}")
    return 0
