"""The one way to switch the torque of servos on, where they stand, and the one way to relax them.

They serve requests, STOP, faults, the end of a run, and programs that have no running bus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from typing import Final, TypeVar

from head_tracking.dynamixel.exceptions import (
    DynamixelError,
    LineBusyError,
    NotConnectedError,
    PortLostError,
    PositionError,
    RegisterRefusedError,
    ServoError,
)
from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.servo import Servo, run

_T = TypeVar("_T")
_PATIENCE: Final = 0.5  # s to wait for a gap between the packets of a second program


def pin(servo: Servo, allowed: tuple[int, int] | None = None, powered: bool = False) -> Steps[int]:
    """Switch torque on where the servo stands, without a jump; return the goal, in ticks.

    The goal is written, and read back, before torque is switched on, because a servo starts
    for its old goal at that moment. It is written together with the lowest speed, because an
    AX servo switches torque on by itself when a goal arrives, as Feetech servos seem to, and a
    relaxed servo may have been moved since its position was read. A shaft outside the range creeps
    to its end.

    Args:
        servo: The servo.
        allowed: Lowest and highest tick for the goal; None: its range.
        powered: Whether its torque must be on already: one that is relaxed stays so.

    Raises:
        ServoError: It was to have torque on, and has not.
        PositionError: It stands where the way to its range could lead the other way round.
        RegisterRefusedError: The servo does not take the goal or the torque.
    """
    if powered and not servo.get("Torque Enable"):
        raise ServoError(f"servo {servo.id} has lost its torque, so it stays relaxed")
    servo.confirmed = False
    servo.pins += 1
    yield from servo.disarm()  # one that has tripped refuses goals until it is cleared
    before = servo.get("Present Position")
    if not powered:
        require_straight_path(servo, before)
    yield 0.0
    lowest, highest = allowed or servo.range
    goal = max(lowest, min(highest, before))
    values = servo.model.goal_values(goal, servo.model.speed_minimum)
    yield from servo.verify(servo.model.goal, *values)
    yield from servo.switch_torque(True)
    if servo.model.endless and not powered:
        now = servo.get("Present Position")
        yield 0.0
        if abs(now - before) > servo.model.ticks // 4:
            raise PositionError(
                f"servo {servo.id} was turned over the end of its scale while its torque came "
                "on; hold it still and try again"
            )
    yield from servo.arm()
    servo.note_torque()
    return goal


def require_straight_path(servo: Servo, ticks: int) -> None:
    """Refuse a position, in ticks, from which a relaxed servo could turn the wrong way.

    With torque on, a servo turns towards higher ticks for a higher goal. Its shaft goes all
    round, and its scale has a seam: from beyond it, the way to a goal leads round the other
    way, through what is forbidden. So a shaft that is more than half a turn from the middle of
    its range is taken for one that was turned over the seam by hand. While it is relaxed, an X
    servo counts the turns; torque on forgets them. In the dead angle of an AX servo its
    position reads as an end of the scale.

    Raises:
        PositionError: It is such a position.
    """
    lowest, highest = servo.range
    last = servo.model.ticks - 1
    turn = 2.0 * math.pi / servo.model.radians_per_tick  # in ticks
    far = abs(2 * ticks - lowest - highest) > turn
    if servo.model.endless:
        if 0 <= ticks <= last and not far:
            return
    elif not (far or ticks <= 0 < lowest or ticks >= last > highest):
        return
    raise PositionError(
        f"servo {servo.id} stands at tick {ticks}, outside its range {lowest} to {highest}: "
        "its way back could lead over the seam of its scale or its dead angle, the other way "
        "round. Torque stays off; turn it back into its range by hand, then try again"
    )


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
    pins = {servo.id: servo.pins for servo in servos}
    for servo in servos:
        servo.confirmed = False
    with suppress(PortLostError, NotConnectedError):  # what follows finds that out, too
        release(port, servos)
    yield 0.0
    problems: dict[int, str] = {}
    for servo in servos:
        try:
            if servo.lost:
                raise ServoError("the servo does not answer")
            yield from _confirming(servo, pins[servo.id], disarm)
        except DynamixelError as cause:
            problems[servo.id] = str(cause)
        else:
            problems[servo.id], servo.confirmed = "", True
            yield 0.0
    return problems


def _confirming(servo: Servo, pins: int, disarm: bool) -> Steps[None]:
    """Make sure that a servo is relaxed, unless somebody switches its torque on meanwhile."""

    def steps() -> Steps[None]:
        if servo.get("Torque Enable"):
            yield 0.0
            yield from servo.switch_torque(False)
        if disarm:
            yield 0.0
            yield from servo.disarm()

    return unless(lambda: servo.pins != pins, steps())


def unless(overtaken: Callable[[], bool], steps: Steps[_T]) -> Steps[_T]:
    """Take steps until somebody else has switched the torque of that servo, or of its joint.

    Raises:
        ServoError: Somebody has.
    """
    while not overtaken():
        try:
            yield next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
    raise ServoError("somebody has switched its torque meanwhile")


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
        problems = dict.fromkeys(models, "")
        for servo in servos:
            try:
                _hold(servo)
            except DynamixelError as cause:
                problems[servo.id] = str(cause)
        return problems


def _hold(servo: Servo) -> None:
    """Hold a servo that has torque on where it stands; a relaxed one stays relaxed."""
    if servo.get("Torque Enable"):
        if servo.model.watchdog is not None:  # one that has tripped refuses goals
            with suppress(RegisterRefusedError):  # older firmware has none
                run(servo.set_watchdog(0))
        run(pin(servo, powered=True))
