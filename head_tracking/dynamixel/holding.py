"""The one way to switch torque on: the servo holds where it stands."""

from __future__ import annotations

import math
from contextlib import suppress

from head_tracking.dynamixel.exceptions import PositionError, RegisterRefusedError, ServoError
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.servo import SLOWEST, Servo


def pin(servo: Servo, allowed: tuple[int, int] | None = None, powered: bool = False) -> Steps[int]:
    """Switch torque on where the servo stands, without a jump; return the goal, in ticks.

    The goal is written, and read back, before torque is switched on, because a servo starts
    for its old goal at that moment. It is written together with the lowest speed, because an
    AX servo switches torque on by itself when a goal arrives, and a relaxed servo may have
    been moved since its position was read. A shaft outside the range creeps to its end.

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
    yield from servo.disarm()  # one that has tripped refuses goals until it is cleared
    before = servo.get("Present Position")
    if not powered:
        require_straight_path(servo, before)
    yield 0.0
    lowest, highest = allowed or servo.range
    goal = max(lowest, min(highest, before))
    values = (goal, SLOWEST) if servo.model.position_first else (SLOWEST, goal)
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


def holding(servo: Servo) -> Steps[None]:
    """Hold a servo that has torque on where it stands; a relaxed one stays relaxed.

    Raises:
        CommunicationError: It does not answer.
        ServoError: It does not take the goal.
    """
    if not servo.get("Torque Enable"):
        return
    yield 0.0
    if servo.model.watchdog is not None:  # one that has tripped refuses goals until it is cleared
        with suppress(RegisterRefusedError):  # older firmware has none
            yield from servo.set_watchdog(0)
    yield from pin(servo, powered=True)
