"""servo monitor: a table of what servos measure, again and again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rich.table import Table
from rich.text import Text

from head_tracking.dynamixel.dynamixel_port import DynamixelPort
from head_tracking.dynamixel.exceptions import CommunicationError, CorruptReplyError
from head_tracking.dynamixel.models import ServoModel
from head_tracking.dynamixel.protocol import describe_errors
from head_tracking.dynamixel.servo_link import Feedback, ServoLink
from head_tracking.servo_tool.exceptions import ToolError
from head_tracking.servo_tool.workshop import Workshop, find_servo, protocol_of

_COLUMNS = (
    "id", "model", "torque", "ticks", "rad", "deg", "rad/s", "load", "V", "°C", "failed", "errors",
)  # fmt: skip
_FIRST_IDS = range(0, 30)


@dataclass(slots=True)
class Watched:
    """A servo and the last that was heard of it."""

    link: ServoLink
    feedback: Feedback | None = None
    torque: bool = False
    errors: str = ""
    failed: bool = field(default=False)


def monitor(
    workshop: Workshop,
    ids: Sequence[int],
    model: ServoModel | None,
    *,
    rate: float,
    count: int | None,
) -> int:
    """Show what servos measure until Ctrl-C, or `count` times; return the exit code."""
    with workshop.port() as port:
        servos = [Watched(find_servo(port, i, model)) for i in ids or _present(port)]
        if not servos:
            raise ToolError(
                f"no servo with an id up to {_FIRST_IDS[-1]} answers at {workshop.baud_rate} baud; "
                "name the ids, or look for servos with `servo scan`"
            )
        with workshop.terminal.screen() as screen:
            shown = 0
            while count is None or shown < count:
                next_look = workshop.clock() + 1.0 / rate
                for servo in servos:
                    _look(servo)
                screen.update(table(servos))
                shown += 1
                if shown != count:
                    workshop.pause(max(0.0, next_look - workshop.clock()))
    return 0


def _present(port: DynamixelPort) -> list[int]:
    return [i for i in _FIRST_IDS if protocol_of(port, i, attempts=1) is not None]


def _look(servo: Watched) -> None:
    try:
        feedback = servo.link.read_feedback(retries=0)
        servo.torque = bool(servo.link.get("Torque Enable"))
        servo.errors = describe_errors(servo.link.errors(feedback.error))
    except CommunicationError as failure:
        servo.failed = True
        damaged = isinstance(failure, CorruptReplyError)
        servo.errors = "damaged answer" if damaged else "no answer"
    else:
        servo.feedback, servo.failed = feedback, False


def table(servos: Sequence[Watched]) -> Table:
    """Return what is known of the servos; what is old is dim."""
    shown = Table(box=None, padding=(0, 1, 0, 0))
    for name in _COLUMNS:
        left = name in ("model", "torque", "errors")
        shown.add_column(name, justify="left" if left else "right", no_wrap=name != "errors")
    for servo in servos:
        counters = servo.link.counters
        failures = counters.timeouts + counters.corrupt
        cells = [
            str(servo.link.id),
            servo.link.model.name,
            *_measured(servo),
            f"{failures}/{failures + counters.replies}",
            servo.errors,
        ]
        style = "dim" if servo.failed else "red" if servo.errors != "none" else ""
        shown.add_row(*(Text(cell) for cell in cells), style=style)
    return shown


def _measured(servo: Watched) -> list[str]:
    feedback, model = servo.feedback, servo.link.model
    if feedback is None:
        return [""] * 8
    registers = [model.feedback.registers[place] for place in model.feedback_order]
    position, speed, load, volts, celsius = (
        register.in_unit(value) for register, value in zip(registers, feedback[:5], strict=True)
    )
    return [
        "on" if servo.torque else "off",
        str(feedback.ticks),
        f"{position:+.3f}",
        f"{math.degrees(position):+.1f}",
        f"{speed:+.2f}",
        f"{load:+.0f} {registers[2].unit.symbol}",
        f"{volts:.1f}",
        f"{celsius:.0f}",
    ]
