"""Types for argparse whose errors say what is allowed."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")


def finite(text: str) -> float:
    """Any finite number."""
    return _number(text, math.isfinite, "is not a finite number")


def above_zero(text: str) -> float:
    """A finite number above 0."""
    return _number(text, _is_above_zero, "is not a number above 0")


def seconds(text: str) -> float:
    """A duration [s]."""
    return _number(text, _is_above_zero, "is no duration; give seconds above 0")


def between(
    lowest: float, highest: float, unit: str, kind: type[float] = float
) -> Callable[[str], float]:
    """The type of a number from `lowest` to `highest`; `kind` is int if it has to be whole."""
    return lambda text: _number(
        text,
        lambda number: lowest <= number <= highest,
        f"is not possible; allowed are {lowest:g} to {highest:g} {unit}",
        kind,
    )


def servo_id(text: str) -> int:
    """The id of a Dynamixel servo."""
    if not text.isdigit() or int(text) > 253:
        raise ArgumentTypeError(f"{text!r} is no servo id; ids are 0 to 253")
    return int(text)


def read_by(read: Callable[[str], Value], error: type[Exception]) -> Callable[[str], Value]:
    """The type of what `read` makes of a text; the message of its own error tells what is wrong."""

    def read_argument(text: str) -> Value:
        try:
            return read(text)
        except error as reason:
            raise ArgumentTypeError(str(reason)) from None

    return read_argument


def _number(
    text: str, allowed: Callable[[float], bool], complaint: str, kind: type[float] = float
) -> float:
    try:
        number = kind(text)
    except ValueError:
        number = math.nan
    if not allowed(number):
        raise ArgumentTypeError(f"{text!r} {complaint}")
    return number


def _is_above_zero(number: float) -> bool:
    return 0.0 < number < math.inf
