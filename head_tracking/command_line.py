"""Command lines: types for argparse whose errors say what is allowed, and exit codes."""

from __future__ import annotations

import math
import re
import sys
from argparse import ArgumentTypeError
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

from head_tracking.exceptions import HeadTrackingError, RefusedError

Value = TypeVar("Value")

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 3, 130
"""Exit codes of tools; 2 is argparse's, for a wrong command line."""


def exit_code(tool: str, work: Callable[[], int]) -> int:
    """Do a tool's work and return its exit code; print an error that its user can mend."""
    try:
        return work()
    except RefusedError as error:
        print(f"{tool}: refused: {error}", file=sys.stderr)
        return REFUSED
    except (HeadTrackingError, OSError) as error:
        print(f"{tool}: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED


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


class PointInFrame(NamedTuple):
    """A point [m] and the frame that it is in."""

    point: tuple[float, float, float]
    frame_id: str


def point_in_frame(text: str) -> PointInFrame:
    """A point in metres and its frame, such as 1,0.5,0@base_link."""
    numbers, _, frame_id = text.strip().partition("@")
    try:
        x, y, z = (float(number) for number in numbers.split(","))
    except ValueError:
        x = y = z = math.nan
    if not frame_id or not all(map(math.isfinite, (x, y, z))):
        raise ArgumentTypeError(
            f"{text!r} is no point; give three numbers in metres and a frame, such as "
            "1,0.5,0@base_link"
        )
    return PointInFrame((x, y, z), frame_id)


def with_points(arguments: Sequence[str]) -> list[str]:
    """The command line, so that argparse takes a point that begins with a minus for no option."""
    return [f" {word}" if re.match(r"-[\d.]\S*@", word) else word for word in arguments]


def with_numbers(arguments: Sequence[str]) -> list[str]:
    """The command line, so that argparse takes a value such as -30deg for no option."""
    return [f" {word}" if re.match(r"-\.?\d", word) else word for word in arguments]


def servo_id(text: str) -> int:
    """The id of a Dynamixel servo."""
    if not text.isdigit() or int(text) > 253:
        raise ArgumentTypeError(f"{text!r} is no servo id; ids are 0 to 253")
    return int(text)


def named_id(text: str) -> tuple[str, int]:
    """Return the name and the id of a servo, such as XM430-W350:1 or head_pan:1."""
    name, _, number = text.rpartition(":")
    if not name:
        raise ArgumentTypeError(f"{text!r} is not NAME:ID, such as XM430-W350:1 or head_pan:1")
    return name, servo_id(number)


def writable_file(text: str) -> Path:
    """Return a path that can be written, tried without a change to what is there."""
    path = Path(text)
    try:
        was_there = path.exists()
        path.open("a").close()
        if not was_there:
            path.unlink()
    except OSError as error:
        raise ArgumentTypeError(
            f"{text!r} cannot be written ({error.strerror}); give a file in a folder that can"
        ) from None
    return path


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
