"""The one way to relax servos.

It serves requests, STOP, faults, the end of a run, and programs
that have no running bus.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from typing import Final

from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    LineBusyError,
    NotConnectedError,
    PortLostError,
    ServoError,
)
from head_tracking.dynamixel.holding import holding
from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.servo import Servo, run

_PATIENCE: Final = 0.5  # s to wait for a gap between the packets of a second program


def relaxing(
    port: DynamixelPort, servos: Sequence[Servo], *, disarm: bool = False
) -> Steps[dict[int, str]]:
    """Switch torque off: the first step does it for all, the others make sure of each.

    Args:
        port: Where the servos are.
        servos: Which.
        disarm: Whether to switch off the Bus Watchdog of those that have one, too.

    Returns:
        By id, why a servo did not confirm that it is relaxed; empty where it did.
    """
    for servo in servos:
        servo.confirmed = False
    with suppress(PortLostError, NotConnectedError):  # what follows finds that out, too
        release(port, servos)
    yield 0.0
    problems: dict[int, str] = {}
    for servo in servos:
        problems[servo.id] = yield from _confirming(servo, disarm)
    return problems


def _confirming(servo: Servo, disarm: bool) -> Steps[str]:
    """Make sure that a servo is relaxed; return what went wrong, or nothing."""
    if servo.lost:
        return "the servo does not answer"
    try:
        if servo.get("Torque Enable"):
            yield 0.0
            yield from servo.switch_torque(False)
        if disarm:
            yield 0.0
            yield from servo.disarm()
    except (CommunicationError, ServoError, PortLostError, NotConnectedError) as cause:
        return str(cause)
    servo.confirmed = True
    yield 0.0
    return ""


def release(port: DynamixelPort, servos: Iterable[Servo]) -> None:
    """Write torque off to servos, in one packet for each protocol, and wait for nothing."""
    packets: dict[tuple[int, int], dict[int, bytes]] = {}
    for servo in servos:
        register = servo.model.control_table["Torque Enable"]
        packets.setdefault((servo.model.protocol, register.address), {})[servo.id] = b"\0"
    for (protocol, address), shares in packets.items():
        with suppress(LineBusyError):  # whoever makes sure of it reports it
            port.sync_write(address, shares, protocol, patience=_PATIENCE)


def relax_servos(
    port_name: str,
    models: Mapping[int, str],
    baud_rate: int = 1_000_000,
    *,
    hold: bool = False,
    make_port: Callable[[str, int], DynamixelPort] = DynamixelPort,
) -> dict[int, str]:
    """Relax servos without a running bus, for example when the program that drove them has died.

    Args:
        port_name: Device, such as /dev/ttyUSB0.
        models: Name of each servo's model, by id.
        baud_rate: Bits per second.
        hold: Hold those that have torque on where they stand instead.
        make_port: Makes the port, from its name and baud rate.

    Returns:
        By id, what went wrong; empty where a servo has confirmed.

    Raises:
        ConfigurationError: A model is unknown, or the baud rate is not possible.
        PortError: The port cannot be opened.
    """
    port = make_port(port_name, baud_rate)
    servos = [Servo(port, servo_id, servo_model(name)) for servo_id, name in models.items()]
    port.open()
    with closing(port):
        if not hold:
            return run(relaxing(port, servos))
        problems: dict[int, str] = {}
        for servo in servos:
            try:
                run(holding(servo))
                problems[servo.id] = ""
            except (CommunicationError, ServoError, PortLostError, NotConnectedError) as cause:
                problems[servo.id] = str(cause)
        return problems
