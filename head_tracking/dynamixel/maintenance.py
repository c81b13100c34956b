"""Rare procedures of one servo, as steps: clear a shutdown, write its memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from head_tracking.dynamixel.exceptions import RegisterRefusedError, ServoError
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.servo import Servo

EEPROM_PAUSE: Final = 0.025
"""Seconds to leave a servo alone after a write to its EEPROM: it answers at once and is deaf for
some 6 ms per byte afterwards (fact sheet, section 9)."""


def recover(servo: Servo) -> Steps[None]:
    """Clear a shutdown.

    A protocol 1.0 servo of Dynamixel has set its Torque Limit to 0 and gets it back; others
    restart, do not answer for a while, and are to be identified anew.

    Raises:
        RegisterRefusedError: The servo does not take its torque limit.
    """
    if servo.model.restarts:
        servo.reboot()
        return
    limit = servo.get("Max Torque")
    yield 0.0
    yield from servo.verify(servo.model.control_table.block("Torque Limit"), limit)
    servo.faulted = False


def lock_eeprom(servo: Servo, locked: bool) -> Steps[None]:
    """Write the lock of a Feetech servo, which forgets at power-off what is written under it.

    Raises:
        RegisterRefusedError: It does not take it.
    """
    table = servo.model.control_table
    if "EEPROM Lock" in table:
        yield from servo.verify(table.block("EEPROM Lock"), int(locked))


def write_eeprom(servo: Servo, wanted: Mapping[str, int]) -> Steps[dict[str, tuple[int, int]]]:
    """Write settings that differ, with the pauses that servos need, and read them back.

    The memory wears out: what is there already is not written again. That of a Feetech servo keeps
    only what is written while its lock is off.

    Args:
        servo: The servo.
        wanted: Register values by name.

    Returns:
        Old and new value of what was changed, by register name.

    Raises:
        ServoError: Its torque is on, its memory is locked, or it does not keep a value.
    """
    table = servo.model.control_table
    if servo.get("Torque Enable"):
        raise ServoError(f"servo {servo.id} has its torque on; relax it before changing its memory")
    yield 0.0
    if "Lock" in table and servo.get("Lock"):
        raise ServoError(
            f"servo {servo.id} has its memory locked (register {table['Lock'].address}); cycle "
            "its power"
        )
    changed: dict[str, tuple[int, int]] = {}
    for name, value in wanted.items():
        yield 0.0
        before = servo.get(name)
        if before == value:
            continue
        yield 0.0
        block = table.block(name)
        yield from lock_eeprom(servo, False)
        servo.write(block, value)
        if name == "Status Return Level":
            servo.acknowledges_writes = servo.model.acknowledges_writes(value)
        yield EEPROM_PAUSE * block.length
        after = servo.get(name)
        yield from lock_eeprom(servo, True)
        if after != value:
            raise RegisterRefusedError(
                f"servo {servo.id} keeps {after} in {name} instead of {value}"
            )
        changed[name] = (before, value)
    return changed
