"""servo scan, info, monitor: which servos there are, their registers, what they measure."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import count as count_from
from typing import Final, NamedTuple

from rich.table import Table
from rich.text import Text

from head_tracking.cli.servo.bench import (
    ToolError,
    Workshop,
    find_servo,
    model_number,
    protocol_of,
)
from head_tracking.cli.servo.register_values import in_words
from head_tracking.dynamixel.configuration import BusSettings
from head_tracking.dynamixel.diagnosis import conditions
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    PortBusyError,
    PortError,
    PortMissingError,
    PortPermissionError,
    ServoError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import describe_errors
from head_tracking.dynamixel.servo import Servo, model_name, run

USUAL_BAUD_RATES: Final = (1_000_000, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000)
"""The factory's and those that people change to; the first ones find the most."""

_FEW: Final = 30  # up to so many ids are asked one by one, which is quicker than all at once
_NEAR: Final = 0.1  # of a baud rate: servos and ports round theirs
_FIRST_IDS: Final = range(0, 30)
_COLUMNS: Final = (
    "id", "model", "torque", "ticks", "rad", "deg", "rad/s", "load", "V", "°C", "failed", "errors",
)  # fmt: skip


class FoundServo(NamedTuple):
    """A servo that answered.

    Attributes:
        baud_rate: Bits per second that its own register holds; where it cannot be read, those at
            which it was asked.
        id: Its id.
        protocol: 1 or 2.
        model: Name of its model, or why it is not known.
        is_damaged: Whether its answers are damaged.
    """

    baud_rate: int
    id: int
    protocol: int
    model: str
    is_damaged: bool


def scan(workshop: Workshop, baud_rates: Sequence[int], ids: Sequence[int]) -> int:
    """Look for servos, show them, and return the exit code: 1 if there are none."""
    terminal = workshop.terminal
    found = find_servos(workshop, baud_rates, ids)
    if not found:
        rates = ", ".join(map(str, baud_rates))
        terminal.say(
            f"no servo answers on {workshop.port_name} at {rates} baud; check power and cables, or "
            "name other baud rates with --bauds"
        )
        return 1
    order = {rate: number for number, rate in enumerate(baud_rates)}
    found.sort(key=lambda servo: (order.get(servo.baud_rate, len(order)), servo.id))
    table = Table("baud rate", "id", "model", "protocol", box=None)
    for servo in found:
        table.add_row(str(servo.baud_rate), str(servo.id), servo.model, f"{servo.protocol}.0")
    terminal.show(table)
    for servo_id, times in Counter(servo.id for servo in found).items():
        if times > 1:
            taken = f"is taken {times} times"
        elif any(servo.is_damaged and servo.id == servo_id for servo in found):
            taken = "is probably taken twice, for its answers are damaged"
        else:
            continue
        terminal.say(
            f"id {servo_id} {taken}; on one bus each servo needs its own: connect one of them "
            "alone and use `servo set-id`"
        )
    return 0


def find_servos(
    workshop: Workshop, baud_rates: Sequence[int], ids: Sequence[int]
) -> list[FoundServo]:
    """Return the servos that answer pings; messages go to the terminal.

    Args:
        workshop: The port and the terminal.
        baud_rates: To try, in this order; one that adapter or port cannot do is left out.
        ids: To ask.

    Raises:
        PortError: There is no such port, it is in use, or may not be opened.
    """
    found: list[FoundServo] = []
    terminal = workshop.terminal
    for rate in baud_rates:
        here: list[FoundServo] = []
        try:
            with workshop.port(rate) as port:
                second = set(ids) if len(ids) <= _FEW else set(port.find_all())
                for servo_id in terminal.track(ids, f"{rate} baud"):
                    protocols = (1, 2) if servo_id in second else (1,)
                    here += [each for p in protocols if (each := _found(port, servo_id, p))]
        except (PortMissingError, PortBusyError, PortPermissionError):
            raise
        except (ConfigurationError, PortError) as error:
            terminal.say(f"{rate} baud left out: {error}")
        found += here
        if any(abs(servo.baud_rate - rate) > _NEAR * rate for servo in here):
            terminal.say(
                f"{workshop.port_name} reaches servos whatever the baud rate, as some USB adapters "
                "and simulated buses do: each is shown once, at the rate it is set to"
            )
            break
    return found


def _found(port: DynamixelPort, servo_id: int, protocol: int) -> FoundServo | None:
    """Return what can be read of a servo; None if it answers no ping."""
    if protocol == 2 and servo_id > 252:
        return None
    try:
        port.ping(servo_id, protocol)
    except CommunicationError:
        return None
    rate, model, is_damaged = port.baud_rate, "answers no reads", False
    try:
        number = model_number(port, servo_id, protocol)
        model = model_name(number)
        link = Servo(port, servo_id, servo_model_by_number(number))
        rate = link.model.baud_rates.get(link.get("Baud Rate"), rate)
        link.read_feedback(3)
    except CorruptReplyError:
        is_damaged = True
        model = "damaged answers" if model == "answers no reads" else model
    except (CommunicationError, ConfigurationError):
        pass
    return FoundServo(rate, servo_id, protocol, model, is_damaged)


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
        meaning = in_words(link.model, register, value)
        kept = "EEPROM" if register.eeprom else "RAM"
        access = "RW" if register.writable else "R"
        table.add_row(str(register.address), register.name, str(value), meaning, kept, access)
    workshop.terminal.show(table)
    return 0


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
        present = ids or [i for i in _FIRST_IDS if protocol_of(port, i, attempts=1) is not None]
        links = [find_servo(port, servo_id, model) for servo_id in present]
        if not links:
            raise ToolError(
                f"no servo with an id up to {_FIRST_IDS[-1]} answers at {workshop.baud_rate} baud; "
                "name the ids, or look for servos with `servo scan`"
            )
        for link in links:
            with suppress(CommunicationError, ConfigurationError, ServoError):
                run(link.identify(keep_torque=True))
        measured = {link.id: [""] * 8 for link in links}
        with workshop.terminal.screen() as update:
            for shown in count_from(1):
                due = workshop.clock() + 1.0 / rate
                table = Table(box=None, padding=(0, 1, 0, 0))
                for name in _COLUMNS:
                    left = name in ("model", "torque", "errors")
                    table.add_column(
                        name, justify="left" if left else "right", no_wrap=name != "errors"
                    )
                for link in links:
                    _add_row(table, link, measured)
                update(table)
                if shown == count:
                    break
                workshop.pause(max(0.0, due - workshop.clock()))
    return 0


def _add_row(table: Table, link: Servo, measured: dict[int, list[str]]) -> None:
    """Read a servo and add what is known of it; what is old is dim."""
    try:
        link.read_feedback()
        measured[link.id] = _measured(link, link.get("Torque Enable"))
        found = [symptom.value for symptom in conditions(link, BusSettings().warm)]
        if (error := link.read_errors()) or not found:
            found.insert(0, describe_errors(error))
        errors = ", ".join(found)
        style = "red" if errors != "none" else ""
    except CommunicationError as error:
        errors = "damaged answer" if isinstance(error, CorruptReplyError) else "no answer"
        style = "dim"
    failures = link.counters.timeouts + link.counters.corrupt
    failed = f"{failures}/{failures + link.counters.replies}"
    cells = (str(link.id), link.model.name, *measured[link.id], failed, errors)
    table.add_row(*map(Text, cells), style=style)


def _measured(link: Servo, torque: int) -> list[str]:
    return [
        "on" if torque else "off",
        str(link.ticks),
        f"{link.position:+.3f}",
        f"{math.degrees(link.position):+.1f}",
        f"{link.velocity:+.2f}",
        f"{100.0 * link.load:+.0f} %",
        f"{link.voltage:.1f}",
        f"{link.temperature:.0f}",
    ]
