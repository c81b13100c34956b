"""Parse and format register values."""

from __future__ import annotations

import math
import re
from enum import IntFlag
from typing import Final

from head_tracking.cli.servo.session import ToolError
from head_tracking.dynamixel.control_table import NUMBER, ControlTable, Register
from head_tracking.dynamixel.exceptions import RangeError
from head_tracking.dynamixel.models import ServoModel
from head_tracking.dynamixel.protocol import describe_errors
from head_tracking.exceptions import RefusedError

_QUANTITY: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(\S*)\s*", re.I)
_OTHER_UNITS: Final = {
    "rad": {"deg": math.radians(1.0), "°": math.radians(1.0)},
    "rad/s": {"deg/s": math.radians(1.0), "rpm": 2.0 * math.pi / 60.0},
    "µs": {"us": 1.0, "ms": 1e3},
    "ms": {"s": 1e3},
    "°C": {"C": 1.0},
    "mA": {"A": 1e3},
    "V": {"mV": 1e-3},
}
"""Other units that are accepted, by the unit of the register."""

_UNLIMITED: Final = ("Moving Speed", "Profile Velocity")
"""Registers in which 0 means full speed."""


def find_register(table: ControlTable, text: str) -> Register:
    """Return the register with a name, in any case, or at an address.

    Raises:
        ToolError: there is none.
    """
    wanted = text.strip().replace("_", " ").lower()
    for register in table:
        if register.name.lower() == wanted or str(register.address) == wanted:
            return register
    near = [register.name for register in table if wanted in register.name.lower()]
    names = near or [r.name for r in table if not r.name.startswith("Indirect")]
    raise ToolError(f"{table.name} has no register {text!r}; it has {', '.join(names)}")


def parse_value(model: ServoModel, register: Register, text: str) -> int:
    """Convert counts, a quantity with its unit, or "full" to the value of a register.

    A baud rate of the model is a quantity in baud.

    Raises:
        ToolError: the text is none of them, or outside the register's range.
        RefusedError: the value 0 would mean full speed.
    """
    if register.name == "Baud Rate":
        rates = {f"{rate} baud": code for code, rate in model.baud_rates.items()}
        codes = rates | {str(code): code for code in rates.values()}
        if text not in codes:
            raise ToolError(f"{model.name} has no {text}; {register.name} is {', '.join(rates)}")
        return codes[text]
    is_speed = register.name in _UNLIMITED
    if is_speed and text.strip().lower() in ("full", "full speed"):
        return 0
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ToolError(f"{text!r} is not a value for {register.name}; {_allowed(register)}")
    number, unit = float(match[1]), match[2]
    own = register.unit.symbol
    scales = {own: 1.0} | _OTHER_UNITS.get(own, {}) if own else {}
    if unit and unit not in scales:
        units = ", ".join(scales) or "none"
        raise ToolError(f"{register.name} has no unit {unit!r}; its units: {units}")
    if not unit and number != int(number):
        raise ToolError(f"{register.name} needs a whole number; {_allowed(register)}")
    try:
        if unit:
            value = register.from_unit(number * scales[unit])
        else:
            value = register.from_counts(int(number))
    except (RangeError, OverflowError):
        value = None
    if value is None or not register.writable or not register.admits(value):
        raise ToolError(f"{register.name} cannot be {text}; {_allowed(register)}")
    if is_speed and not value:
        raise RefusedError(
            f"{register.name} 0 is not a stop but full speed; the slowest is 1, "
            f"{register.in_unit(1):.4g} {own}. For full speed give the value `full`"
        )
    return value


def as_text(model: ServoModel, register: Register, value: int) -> str:
    """Return a value in its unit, or the meaning of a code; empty for plain numbers."""
    if register.name == "Baud Rate":
        return f"{model.baud_rates.get(value, '?')} baud"
    if register.name in ("Shutdown", "Alarm LED", "Hardware Error Status"):
        errors: IntFlag = model.errors(value & sum(model.errors))
        return describe_errors(errors)
    if register.unit == NUMBER:
        return ""
    if register.name in _UNLIMITED and value == 0:
        return "full speed"
    try:
        quantity = register.in_unit(value)
    except RangeError:
        return "?"
    text = f"{quantity:.4g} {register.unit.symbol}"
    if register.unit.symbol == "rad":
        text += f" ({math.degrees(quantity):.1f}°)"
    return text


def _allowed(register: Register) -> str:
    if not register.writable or register.minimum is None or register.maximum is None:
        return "it is read-only"
    if register.sign_bit:
        largest = (1 << register.sign_bit) - 1
        return f"allowed are {-min(largest, register.maximum)} to {min(largest, register.maximum)}"
    text = f"allowed are {register.minimum} to {register.maximum}"
    if register.unit.symbol:
        low, high = register.in_unit(register.minimum), register.in_unit(register.maximum)
        text += f", that is {low:.4g} to {high:.4g} {register.unit.symbol}"
    return text
