"""servo scan, info, monitor: what is there, what it is set to, what it measures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from rich.table import Table
from rich.text import Text

from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    PortBusyError,
    PortError,
    PortMissingError,
    PortPermissionError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import describe_errors
from head_tracking.dynamixel.servo import Feedback, Servo, model_name
from head_tracking.tools.servo.bench import (
    MODEL_NUMBER,
    ToolError,
    Workshop,
    find_servo,
    protocol_of,
    read_model_number,
)
from head_tracking.tools.servo.registers import in_words

USUAL_BAUD_RATES: Final = (1_000_000, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000)
"""The factory's and those that people change to; the first ones find the most."""

_FEW: Final = 30  # up to so many ids are asked one by one, which is quicker than all at once


@dataclass(frozen=True, slots=True)
class Found:
    """A servo that answered.

    Attributes:
        baud_rate: Bits per second at which it was asked.
        protocol: 1 or 2.
        id: Its id.
        model_number: Its Model Number; None if it answers no reads.
        set_to: The baud rate that its own register tells; None: nobody knows.
        garbled: Whether its answers are damaged, though it is there.
    """

    baud_rate: int
    protocol: int
    id: int
    model_number: int | None
    set_to: int | None = None
    garbled: bool = False


def scan(workshop: Workshop, baud_rates: Sequence[int], ids: Sequence[int]) -> int:
    """Look for servos, show them, and return the exit code: 1 if there are none."""
    found: list[Found] = []
    terminal = workshop.terminal
    with terminal.progress(len(baud_rates) * len(ids)) as advance:
        for rate in baud_rates:
            try:
                with workshop.port(rate) as port:
                    found += _scan_port(port, ids, advance)
            except (PortMissingError, PortBusyError, PortPermissionError):
                raise
            except (ConfigurationError, PortError) as error:
                terminal.say(f"{rate} baud left out: {error}")
                advance("", len(ids))
    if not found:
        rates = ", ".join(map(str, baud_rates))
        terminal.say(
            f"no servo answers on {workshop.port_name} at {rates} baud; check power and cables, or "
            "name other baud rates with --bauds"
        )
        return 1
    if any(servo.set_to not in (None, servo.baud_rate) for servo in found):
        terminal.say(
            f"{workshop.port_name} reaches servos whatever the baud rate, as some USB adapters and "
            "simulated buses do: each is shown once, at the rate it is set to"
        )
        found = _each_once(found)
    order = {rate: number for number, rate in enumerate(baud_rates)}
    found.sort(key=lambda servo: (order.get(servo.baud_rate, len(order)), servo.id))
    terminal.show(_found_table(found))
    _warn_of_twins(workshop, found)
    return 0


def _scan_port(
    port: DynamixelPort, ids: Sequence[int], advance: Callable[[str, int], None]
) -> Iterator[Found]:
    what = f"{port.baud_rate} baud"
    second: set[int] = set()
    if len(ids) > _FEW:
        for servo_id, (model_number, _) in sorted(port.find_all().items()):
            if servo_id in ids:
                second.add(servo_id)
                yield _found(port, 2, servo_id, model_number)
    for servo_id in ids:
        for protocol in (1, 2):
            known = protocol == 2 and (servo_id in second or len(ids) > _FEW or servo_id > 252)
            if not known and _answers(port, servo_id, protocol):
                number = read_model_number(port, servo_id, protocol)
                yield _found(port, protocol, servo_id, number)
        advance(f"{what}, id {servo_id}", 1)


def _found(port: DynamixelPort, protocol: int, servo_id: int, number: int | None) -> Found:
    """Return what can be told of a servo that answers pings."""
    rate, garbled = None, False
    try:
        if number is None:
            port.read(servo_id, *MODEL_NUMBER, protocol)
        else:
            link = Servo(port, servo_id, servo_model_by_number(number))
            rate = link.model.baud_rates.get(link.get("Baud Rate"))
            link.read_feedback(3)
    except CorruptReplyError:
        garbled = True
    except (CommunicationError, ConfigurationError):
        pass  # it answers no reads, or nobody knows the model
    return Found(port.baud_rate, protocol, servo_id, number, rate, garbled)


def _each_once(found: Sequence[Found]) -> list[Found]:
    """Return each servo once, though it answers at several baud rates."""
    once: dict[tuple[int, int, int | None, int | None], Found] = {}
    for servo in found:
        key = (servo.protocol, servo.id, servo.model_number, servo.set_to)
        once.setdefault(key, replace(servo, baud_rate=servo.set_to or servo.baud_rate))
    return list(once.values())


def _answers(port: DynamixelPort, servo_id: int, protocol: int) -> bool:
    try:
        port.ping(servo_id, protocol)
    except CommunicationError:
        return False
    return True


def _found_table(found: Sequence[Found]) -> Table:
    table = Table("baud rate", "id", "model", "protocol", box=None)
    for servo in found:
        silent = "damaged answers" if servo.garbled else "answers no reads"
        name = silent if servo.model_number is None else model_name(servo.model_number)
        table.add_row(str(servo.baud_rate), str(servo.id), name, f"{servo.protocol}.0")
    return table


def _warn_of_twins(workshop: Workshop, found: Sequence[Found]) -> None:
    """Tell which ids are taken twice: servos with the same id talk at the same time."""
    places: dict[int, list[Found]] = {}
    for servo in found:
        places.setdefault(servo.id, []).append(servo)
    for servo_id, twins in places.items():
        if len(twins) > 1:
            taken = f"is taken {len(twins)} times"
        elif twins[0].garbled:
            taken = "is probably taken twice, for what it answers is damaged"
        else:
            continue
        workshop.terminal.say(
            f"id {servo_id} {taken}; on one bus each servo needs its own: connect one of them "
            "alone and use `servo set-id`"
        )


def info(workshop: Workshop, servo_id: int, model: ServoModel | None, *, all_of_them: bool) -> int:
    """Show the registers of a servo and return the exit code."""
    with workshop.port() as port:
        link = find_servo(port, servo_id, model)
        registers = link.registers()
    name = link.model.name
    workshop.terminal.show(f"servo {servo_id}: {name}, protocol {link.model.protocol}.0")
    table = Table("address", "register", "value", "meaning", "kept", "access", box=None)
    for register, value in registers:
        if register.name.startswith("Indirect") and not all_of_them:
            continue
        table.add_row(
            str(register.address),
            register.name,
            str(value),
            in_words(link.model, register, value),
            "EEPROM" if register.eeprom else "RAM",
            "RW" if register.writable else "R",
        )
    workshop.terminal.show(table)
    return 0


_COLUMNS = (
    "id", "model", "torque", "ticks", "rad", "deg", "rad/s", "load", "V", "°C", "failed", "errors",
)  # fmt: skip
_FIRST_IDS = range(0, 30)


@dataclass(slots=True)
class Watched:
    """A servo and the last that was heard of it."""

    link: Servo
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
                screen.update(_monitor_table(servos))
                shown += 1
                if shown != count:
                    workshop.pause(max(0.0, next_look - workshop.clock()))
    return 0


def _present(port: DynamixelPort) -> list[int]:
    return [i for i in _FIRST_IDS if protocol_of(port, i, attempts=1) is not None]


def _look(servo: Watched) -> None:
    try:
        feedback = servo.link.read_feedback()
        servo.torque = bool(servo.link.get("Torque Enable"))
        servo.errors = describe_errors(servo.link.state_of(feedback.error))
    except CommunicationError as failure:
        servo.failed = True
        damaged = isinstance(failure, CorruptReplyError)
        servo.errors = "damaged answer" if damaged else "no answer"
    else:
        servo.feedback, servo.failed = feedback, False


def _monitor_table(servos: Sequence[Watched]) -> Table:
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
