"""Switch the torque of servos on, at their present position, and off.

Used by requests, STOP, faults, the end of a run, and programs without a running bus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from typing import Final, TypeVar

from head_tracking.dynamixel.exceptions import (
    DynamixelError,
    NotConnectedError,
    PortLostError,
    ServoError,
)
from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.servo import Servo, run

_T = TypeVar("_T")
_SETTLING: Final = 5  # times that the goal of a shaft that still moves is written again
_PATIENCE: Final = 0.2  # s to wait for a gap between the packets of another program


def pin(servo: Servo, allowed: tuple[int, int] | None = None, powered: bool = False) -> Steps[int]:
    """Switch torque on at the present position; return the goal, in ticks.

    The goal is written and read back before torque is switched on, because a servo starts towards
    its old goal at that moment. It is written with the lowest speed, because a goal alone switches
    the torque of an AX servo on, and the shaft may have been turned since its position was read; if
    it still moves, the goal is written again. A shaft outside of the range moves to its end at that
    speed.

    Args:
        servo: The servo.
        allowed: Lowest and highest tick for the goal; None: its range.
        powered: Whether its torque must be on already; a relaxed servo stays relaxed.

    Raises:
        ServoError: Its torque was to be on, and is off; or the way to its range could lead in the
            wrong direction; or it refuses the goal or the torque; or it is not in position mode any
            more, or has another offset or direction.
    """
    if powered and not servo.get("Torque Enable"):
        raise ServoError(f"servo {servo.id} has lost its torque, so it stays relaxed")
    servo.confirmed = False
    allowed = allowed or servo.range
    if not powered:
        yield from servo.check_settings()
    yield from servo.switch_watchdog(False)  # a tripped watchdog refuses goals
    before = servo.get("Present Position")
    if not powered:
        require_straight_path(servo, before, allowed)
    yield 0.0
    goal = yield from _write_slow_goal(servo, before, allowed)
    yield from servo.switch_torque(True)
    for _ in range(_SETTLING):
        now = servo.get("Present Position")
        yield 0.0
        if abs(now - before) <= 1:
            break
        if servo.model.endless and not powered and abs(now - before) > servo.model.ticks // 4:
            raise ServoError(
                f"servo {servo.id} was turned over the end of its scale while its torque came "
                "on; hold it still and try again"
            )
        goal = yield from _write_slow_goal(servo, now, allowed)  # it was moving, and would return
        before = now
    yield from servo.switch_watchdog(True)
    servo.note_torque()
    return goal


def _write_slow_goal(servo: Servo, ticks: int, allowed: tuple[int, int]) -> Steps[int]:
    """Write a goal, moved into the range, with the lowest speed; return it, in ticks."""
    lowest, highest = allowed
    goal, model = max(lowest, min(highest, ticks)), servo.model
    values = model.goal_values((goal, model.speed_minimum, 0))
    yield from servo.verify(model.goal, *values)
    return goal


def require_straight_path(servo: Servo, ticks: int, allowed: tuple[int, int]) -> None:
    """Refuse a position, in ticks, from which a relaxed servo could turn in the wrong direction.

    `allowed`: lowest and highest tick for its goals. Both servos of a joint must have the same one,
    as angles; otherwise they could turn back in opposite directions.

    With torque on, a servo turns towards higher ticks for a higher goal. Beyond the end of its
    scale that way leads all round. So a shaft that is more than half a turn from the middle of its
    range counts as one that was turned over the end by hand. While relaxed, an X servo counts
    turns, and forgets them when torque comes on. In its dead angle an AX servo reads an end of its
    scale.

    Raises:
        ServoError: It is such a position.
    """
    lowest, highest = allowed
    last = servo.model.ticks - 1
    turn = 2.0 * math.pi / servo.model.radians_per_tick  # in ticks
    far = abs(2 * ticks - lowest - highest) > turn
    if servo.model.endless:
        if 0 <= ticks <= last and not far:
            return
    elif not (far or ticks <= 0 < lowest or ticks >= last > highest):
        return
    raise ServoError(
        f"servo {servo.id} is at tick {ticks}, outside its range {lowest} to {highest}: its way "
        "back could lead over the end of its scale or through its dead angle, in the other "
        "direction. Torque stays off; turn it back into its range by hand, then try again"
    )


def relaxing(
    port: DynamixelPort,
    servos: Sequence[Servo],
    *,
    disarm: bool = False,
    sure: Collection[Servo] = (),
) -> Steps[dict[int, str]]:
    """Switch torque off: the first step sends it to all, the others read each servo back.

    `disarm`: switch off their Bus Watchdog, too. Servos in `sure` have confirmed before, and may be
    unplugged now. Returns by id why a servo did not confirm, empty where it did. A servo that did
    not confirm counts as interrupted, so that a cycle in which it answers relaxes it again.
    """
    servos = sorted(servos, key=lambda servo: servo.lost)  # a silent one costs time
    for servo in servos:
        servo.confirmed, servo.held_by = servo in sure, None
    with suppress(PortLostError, NotConnectedError):  # reported by what follows
        release(port, servos)
    problems: dict[int, str] = {}
    try:
        yield 0.0
        for servo in servos:
            try:
                if servo.lost and not servo.is_same():
                    raise ServoError(f"another servo answers as servo {servo.id}")
                yield from while_held_by(None, [servo], _confirming(servo, disarm))
            except DynamixelError as cause:
                servo.confirmed = servo in sure and not isinstance(cause, ServoError)
                problems[servo.id] = "" if servo.confirmed else str(cause)
            else:
                problems[servo.id], servo.confirmed = "", True
                yield 0.0
    finally:
        for servo in servos:
            if not servo.confirmed:
                servo.interrupt()
    return problems


def _confirming(servo: Servo, disarm: bool) -> Steps[None]:
    if servo.get("Torque Enable"):
        yield 0.0
        yield from servo.switch_torque(False)
    if disarm:
        yield 0.0
        yield from servo.switch_watchdog(False)


def while_held_by(request: object | None, servos: Iterable[Servo], steps: Steps[_T]) -> Steps[_T]:
    """Take steps; raise ServoError as soon as another request has switched the torque."""
    while all([servo.held_by is request for servo in servos]):
        try:
            yield next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
    raise ServoError("another request has switched its torque meanwhile")


def release(port: DynamixelPort, servos: Iterable[Servo]) -> None:
    """Write torque off, in one packet for each protocol, without waiting for a confirmation."""
    packets: dict[tuple[int, int], dict[int, bytes]] = {}
    for servo in servos:
        register = servo.model.control_table["Torque Enable"]
        packets.setdefault((servo.model.protocol, register.address), {})[servo.id] = b"\0"
    for (protocol, address), data in packets.items():
        port.sync_write(address, data, protocol, patience=_PATIENCE)


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
        hold: Hold servos with torque on at their present position instead.
        make_port: Makes the port, from its name and baud rate.

    Returns:
        By id, what went wrong; empty where a servo has confirmed.

    Raises:
        ConfigurationError: A model or the baud rate is unknown.
        PortError: The port cannot be opened.
    """
    port = make_port(port_name, baud_rate)
    servos = [Servo(port, servo_id, servo_model(name)) for servo_id, name in models.items()]
    port.open()
    with closing(port):
        if not hold:
            problems = run(relaxing(port, servos))
            for servo in servos:  # one that trips would refuse the goals of other programs
                with suppress(DynamixelError):
                    if servo.confirmed and servo.model.watchdog is not None:
                        run(servo.identify())
                        run(servo.switch_watchdog(False))
            return problems
        problems = dict.fromkeys(models, "")
        for servo in servos:
            try:
                _hold(servo)
            except DynamixelError as cause:
                problems[servo.id] = str(cause)
        return problems


def _hold(servo: Servo) -> None:
    if servo.get("Torque Enable"):
        run(servo.identify(keep_torque=True))
        run(pin(servo, powered=True))
