"""servo scan: what answers, at which baud rate, in which protocol."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from rich.table import Table

from head_tracking.dynamixel.dynamixel_port import DynamixelPort
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    PortBusyError,
    PortError,
    PortMissingError,
    PortPermissionError,
)
from head_tracking.dynamixel.identification import model_name
from head_tracking.servo_tool.workshop import Workshop, read_model_number

USUAL_BAUD_RATES: Final = (1_000_000, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000)
"""The factory's and those that people change to; the first ones find the most."""

_FEW: Final = 30  # up to so many ids are asked one by one, which is quicker than all at once


@dataclass(frozen=True, slots=True)
class Found:
    """A servo that answered.

    Attributes:
        baud_rate: Bits per second.
        protocol: 1 or 2.
        id: Its id.
        model_number: Its Model Number; None if it answers no reads.
    """

    baud_rate: int
    protocol: int
    id: int
    model_number: int | None


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
    found.sort(key=lambda servo: (baud_rates.index(servo.baud_rate), servo.id))
    terminal.show(_table(found))
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
                yield Found(port.baud_rate, 2, servo_id, model_number)
    for servo_id in ids:
        for protocol in (1, 2):
            known = protocol == 2 and (servo_id in second or len(ids) > _FEW or servo_id > 252)
            if not known and _answers(port, servo_id, protocol):
                number = read_model_number(port, servo_id, protocol)
                yield Found(port.baud_rate, protocol, servo_id, number)
        advance(f"{what}, id {servo_id}", 1)


def _answers(port: DynamixelPort, servo_id: int, protocol: int) -> bool:
    try:
        port.ping(servo_id, protocol)
    except CommunicationError:
        return False
    return True


def _table(found: Sequence[Found]) -> Table:
    table = Table("baud rate", "id", "model", "protocol", box=None)
    for servo in found:
        name = "answers no reads" if servo.model_number is None else model_name(servo.model_number)
        table.add_row(str(servo.baud_rate), str(servo.id), name, f"{servo.protocol}.0")
    return table


def _warn_of_twins(workshop: Workshop, found: Sequence[Found]) -> None:
    """Tell which ids are taken twice: servos with the same id talk at the same time."""
    places: dict[int, list[Found]] = {}
    for servo in found:
        places.setdefault(servo.id, []).append(servo)
    for servo_id, twins in places.items():
        if len(twins) > 1:
            workshop.terminal.say(
                f"id {servo_id} is taken {len(twins)} times; on one bus each servo needs its own: "
                "connect one of them alone and use `servo set-id`"
            )
