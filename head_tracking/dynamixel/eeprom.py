"""Settings that a servo keeps without power: written only when somebody asks for it.

A servo answers at once and is deaf for some 6 ms per byte afterwards (fact sheet, section 9), and
the memory wears out: what is there already is not written again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntFlag
from typing import Final

from head_tracking.dynamixel.exceptions import (
    ConfigurationError,
    RegisterRefusedError,
    ServoError,
)
from head_tracking.dynamixel.models import ServoModel
from head_tracking.dynamixel.servo_link import ServoLink

PAUSE: Final = 0.025
"""Time to leave a servo alone after a write, s."""


@dataclass(frozen=True, slots=True)
class EepromSettings:
    """What the servos of a bus shall keep. None leaves a setting as it is.

    Attributes:
        return_delay: Time a servo waits before it answers, microseconds.
        angle_limits: Whether the servo itself shall refuse goals outside the joint's range.
        shutdown: Errors upon which it switches itself off, such as ("overload", "overheating").
        status_return_level: What it answers: 0 pings, 1 also reads, 2 everything.
    """

    return_delay: float | None = 0.0
    angle_limits: bool = True
    shutdown: tuple[str, ...] | None = None
    status_return_level: int | None = 2

    def registers(self, model: ServoModel, tick_range: tuple[int, int]) -> dict[str, int]:
        """Return the register values for a servo, by name.

        Args:
            model: Its model.
            tick_range: Lowest and highest tick of its joint.

        Raises:
            ConfigurationError: The model has no such error, or a value is outside its register.
        """
        wanted: dict[str, int] = {}
        table = model.control_table
        if self.return_delay is not None:
            register = table["Return Delay Time"]
            wanted[register.name] = register.from_unit(self.return_delay)
        if self.angle_limits:
            wanted.update(zip(model.position_limits, tick_range, strict=True))
        if self.shutdown is not None:
            wanted["Shutdown"] = sum(_errors(model, self.shutdown))
        if self.status_return_level is not None:
            wanted["Status Return Level"] = self.status_return_level
        for name, value in wanted.items():
            if not table[name].admits(value):
                raise ConfigurationError(
                    f"{name} of the {model.name} cannot be {value}; allowed are "
                    f"{table[name].minimum} to {table[name].maximum}"
                )
        return wanted


def write_eeprom(
    link: ServoLink, wanted: Mapping[str, int], pause: Callable[[float], object]
) -> dict[str, tuple[int, int]]:
    """Write settings that differ and read them back.

    Args:
        link: The servo.
        wanted: Register values by name.
        pause: Waits so many seconds.

    Returns:
        Old and new value of what was changed, by register name.

    Raises:
        ServoError: Its torque is on, its memory is locked, or it does not keep a value.
        CommunicationError: The servo does not answer.
    """
    if link.get("Torque Enable"):
        raise ServoError(f"servo {link.id} has its torque on; relax it before changing its memory")
    if "Lock" in link.model.control_table and link.get("Lock"):
        raise ServoError(
            f"servo {link.id} has its memory locked (register "
            f"{link.model.control_table['Lock'].address}); cycle its power"
        )
    changed: dict[str, tuple[int, int]] = {}
    for name, value in wanted.items():
        block = link.model.control_table.block(name)
        before = link.get(name)
        if before == value:
            continue
        link.write(block, value)
        if name == "Status Return Level":
            link.acknowledges_writes = value >= 2
        pause(PAUSE * block.length)
        after = link.get(name)
        if after != value:
            raise RegisterRefusedError(
                f"servo {link.id} keeps {after} in {name} instead of {value}"
            )
        changed[name] = (before, value)
    return changed


def _errors(model: ServoModel, names: tuple[str, ...]) -> list[IntFlag]:
    known = {(bit.name or "").lower().replace("_", " "): bit for bit in model.errors}
    for name in names:
        if name not in known:
            raise ConfigurationError(
                f"the {model.name} has no error {name!r}; it has {', '.join(known)}"
            )
    return [known[name] for name in names]
