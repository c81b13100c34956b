"""Short words for the rows of a control table."""

from __future__ import annotations

from head_tracking.dynamixel.control_table import NUMBER, Access, Memory, Register, Sign, Unit

MAGNITUDE = Sign.MAGNITUDE
SIGNED = Sign.TWOS_COMPLEMENT


def eeprom(
    name: str,
    address: int,
    size: int,
    initial: int | None,
    minimum: int,
    maximum: int,
    unit: Unit = NUMBER,
    sign: Sign = Sign.NONE,
) -> Register:
    """Return a setting that survives power-off."""
    return Register(
        name, address, size, Access.READ_WRITE, Memory.EEPROM, initial, minimum, maximum, unit, sign
    )


def ram(
    name: str,
    address: int,
    size: int,
    initial: int | None,
    minimum: int,
    maximum: int,
    unit: Unit = NUMBER,
    sign: Sign = Sign.NONE,
) -> Register:
    """Return a setting that is lost at power-off."""
    return Register(
        name, address, size, Access.READ_WRITE, Memory.RAM, initial, minimum, maximum, unit, sign
    )


def fixed(name: str, address: int, size: int, initial: int | None = None) -> Register:
    """Return a constant of the servo."""
    return Register(name, address, size, Access.READ, Memory.EEPROM, initial)


def measured(
    name: str,
    address: int,
    size: int,
    unit: Unit = NUMBER,
    sign: Sign = Sign.NONE,
    initial: int | None = None,
) -> Register:
    """Return something that the servo tells and nobody sets."""
    return Register(name, address, size, Access.READ, Memory.RAM, initial, None, None, unit, sign)
