"""servo scan, info and monitor."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import count as count_from
from typing import Final, NamedTuple

from rich.table import Table
from rich.text import Text

from head_tracking.cli.servo.register_values import as_text
from head_tracking.cli.servo.session import (
    Session,
    ToolError,
    answers,
    find_servo,
    first_ids,
    model_number,
    none_answers,
)
from head_tracking.dynamixel.configuration import TemperatureParameters
from head_tracking.dynamixel.diagnosis import conditions
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    ServoError,
)
from head_tracking.dynamixel.models import servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import describe_errors
from head_tracking.dynamixel.servo import Servo, model_name, run
from head_tracking.output import is_output_closed

_FEW: Final = 30  # ids; more are found faster by a broadcast ping
_PINGS: Final = 3  # of each of a few ids: an answer may be lost or late
_NEAR: Final = 0.1  # relative difference of baud rates by rounding
_COLUMNS: Final = (
    "id", "model", "torque", "ticks", "rad", "deg", "rad/s", "load", "V", "°C", "failed", "errors",
)  # fmt: skip


class FoundServo(NamedTuple):
    """A servo that answered.

    Attributes:
        baud_rate: value of its register [bit/s]; if that cannot be read, the rate of the ping.
        model: name of its model, or why it is unknown.
    """

    baud_rate: int
    id: int
    protocol: int
    model: str
    is_corrupt: bool


def scan(session: Session, baud_rates: Sequence[int], ids: Sequence[int]) -> None:
    """Find servos and show them; raise a ToolError if there are none."""
    terminal = session.terminal
    found = find_servos(session, baud_rates, ids)
    if not found:
        raise ToolError(
            f"no servo answers on {session.port_name} at {', '.join(map(str, baud_rates))} baud; "
            "check power and cables, or give other baud rates with --bauds"
        )
    order = {rate: number for number, rate in enumerate(baud_rates)}
    found.sort(key=lambda servo: (order.get(servo.baud_rate, len(order)), servo.id))
    table = Table("baud rate", "id", "model", "protocol", box=None)
    for servo in found:
        table.add_row(str(servo.baud_rate), str(servo.id), servo.model, f"{servo.protocol}.0")
    terminal.show(table)
    times = Counter(servo.id for servo in found)
    corrupt = {servo.id for servo in found if servo.is_corrupt}
    for servo_id in (number for number in times if times[number] > 1 or number in corrupt):
        certainty = "is" if times[servo_id] > 1 else "answers corruptly: it is probably"
        terminal.print(
            f"id {servo_id} {certainty} used twice; each servo needs its own id: connect one of "
            "them alone and use `head_tracking servo set-id`"
        )


def find_servos(
    session: Session, baud_rates: Sequence[int], ids: Sequence[int]
) -> list[FoundServo]:
    """Return the servos that answer pings; baud rates that the port does not support are skipped.

    Raises:
        PortError: the port cannot be opened.
    """
    found: list[FoundServo] = []
    terminal = session.terminal
    for rate in baud_rates:
        here: list[FoundServo] = []
        try:
            with session.port(rate) as port:
                is_few = len(ids) <= _FEW
                second = set(ids) if is_few else set(port.find_all())
                tries = _PINGS if is_few else 1
                for servo_id in terminal.track(ids, f"{rate} baud"):
                    protocols = (1, 2) if servo_id in second else (1,)
                    here += [each for p in protocols if (each := _found(port, servo_id, p, tries))]
        except ConfigurationError as error:
            terminal.print(f"{rate} baud skipped: {error}")
        if any(abs(servo.baud_rate - rate) > _NEAR * rate for servo in here):
            known = {servo.id for servo in found}
            found += [servo for servo in here if servo.id not in known]
            terminal.print(
                f"{session.port_name} reaches servos of any baud rate, like some USB adapters and "
                "simulated buses: each servo is listed once, with its own baud rate"
            )
            break
        found += here
    return found


def _found(port: DynamixelPort, servo_id: int, protocol: int, tries: int) -> FoundServo | None:
    """Read identity and state of a servo; return None if it does not answer pings."""
    if not answers(port, servo_id, protocol, tries):
        return None
    rate, model, is_corrupt = port.baud_rate, "", False
    try:
        number = model_number(port, servo_id, protocol)
        model = model_name(number)
        servo = Servo(port, servo_id, servo_model_by_number(number))
        rate = servo.model.baud_rates.get(servo.get("Baud Rate"), rate)
        servo.read_feedback(3)
    except ConfigurationError:
        pass
    except CommunicationError as error:
        # two answers at once may destroy the beginning of each other, which looks like silence
        is_corrupt = bool(model) or isinstance(error, CorruptReplyError)
        model = model or ("corrupt answers" if is_corrupt else "answers no reads")
    return FoundServo(rate, servo_id, protocol, model, is_corrupt)


def info(session: Session, servo_id: int, *, all_of_them: bool) -> None:
    """Show the registers of a servo."""
    with session.port() as port:
        servo = find_servo(port, servo_id, session.model)
        registers = servo.registers()
    session.terminal.show(
        f"servo {servo_id}: {servo.model.name}, protocol {servo.model.protocol}.0"
    )
    table = Table("address", "register", "value", "meaning", "kept", "access", box=None)
    for register, value in registers:
        if all_of_them or not register.name.startswith("Indirect"):
            meaning = as_text(servo.model, register, value)
            kept = "EEPROM" if register.eeprom else "RAM"
            access = "RW" if register.writable else "R"
            table.add_row(str(register.address), register.name, str(value), meaning, kept, access)
    session.terminal.show(table)


def monitor(session: Session, ids: Sequence[int], *, rate: float, count: int) -> None:
    """Show the measured values of servos `count` times; 0: until Ctrl-C."""
    with session.port() as port:
        servos: list[Servo] = []
        for servo_id in ids or first_ids(port):
            try:
                servos.append(find_servo(port, servo_id, session.model))
            except (ToolError, CommunicationError) as error:
                if ids:
                    raise
                session.terminal.print(str(error))  # the others can be shown
        if not servos:
            raise none_answers(port)
        for servo in servos:
            with suppress(CommunicationError, ConfigurationError, ServoError):
                run(servo.identify(keep_torque=True))
        measured = {servo.id: [""] * 8 for servo in servos}
        with session.terminal.screen() as update:
            for shown in count_from(1):
                due = port.clock() + 1.0 / rate
                table = Table(box=None, padding=(0, 1, 0, 0))
                for name in _COLUMNS:
                    left = name in ("model", "torque", "errors")
                    table.add_column(
                        name, justify="left" if left else "right", no_wrap=name != "errors"
                    )
                for servo in servos:
                    _add_row(table, servo, measured)
                update(table)
                if shown == count or is_output_closed():
                    return
                session.pause(max(0.0, due - port.clock()))


def _add_row(table: Table, servo: Servo, measured: dict[int, list[str]]) -> None:
    """Read a servo and add its values; values of a servo that does not answer are dim."""
    try:
        servo.read_feedback()
        measured[servo.id] = _measured(servo, servo.get("Torque Enable"))
        found = [symptom.value for symptom in conditions(servo, TemperatureParameters().warn)]
        if (error := servo.read_errors()) or not found:
            found.insert(0, describe_errors(error))
        errors = ", ".join(found)
        style = "red" if errors != "none" else ""
    except CommunicationError as error:
        errors = "corrupt answer" if isinstance(error, CorruptReplyError) else "no answer"
        style = "dim"
    failures = servo.counters.failed
    failed = f"{failures}/{failures + servo.counters.replies}"
    cells = (str(servo.id), servo.model.name, *measured[servo.id], failed, errors)
    table.add_row(*map(Text, cells), style=style)


def _measured(servo: Servo, torque: int) -> list[str]:
    return [
        "on" if torque else "off",
        str(servo.ticks),
        f"{servo.position:+.3f}",
        f"{math.degrees(servo.position):+.1f}",
        f"{servo.velocity:+.2f}",
        f"{100.0 * servo.load:+.0f} %",
        f"{servo.voltage:.1f}",
        f"{servo.temperature:.0f}",
    ]
