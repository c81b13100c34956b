"""Types and exit codes for command lines."""

from __future__ import annotations

import math
import re
import signal
import sys
from argparse import ArgumentTypeError
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from head_tracking.exceptions import HeadTrackingError, RefusedError
from head_tracking.output import check_output
from head_tracking.share import check_writable
from head_tracking.signals import ending_signals

Value = TypeVar("Value")

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 3, 130
"""Exit codes of tools; 2 is argparse's, for a wrong command line."""


def exit_code(tool: str, work: Callable[[], int | None]) -> int:
    """Run a tool and return its exit code, or DONE; print errors that the user can correct.

    SIGTERM and a closed terminal end it as Ctrl-C does, with 128 + the number of the signal. More
    of them within a second do not interrupt its end.
    """
    try:
        with ending_signals(signal.SIGINT):
            code = work() or DONE
            check_output()
            return code
    except RefusedError as error:
        print(f"{tool}: refused: {error}", file=sys.stderr)
        return REFUSED
    except (HeadTrackingError, OSError) as error:
        print(f"{tool}: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt as interrupt:
        return 128 + interrupt.args[0] if interrupt.args else INTERRUPTED


def between(
    lowest: float, highest: float, unit: str, kind: type[float] = float
) -> Callable[[str], Any]:
    """Return a converter of numbers from `lowest` to `highest`; whole ones if `kind` is int."""

    def convert(text: str) -> Any:
        try:
            number = kind(text)
        except ValueError:
            number = math.nan
        if not lowest <= number <= highest:
            allowed = f"{kind(lowest)} to {kind(highest)} {unit}"
            raise ArgumentTypeError(f"{text!r} is not possible; allowed are {allowed}")
        return number

    return convert


seconds = between(0.001, 1e6, "s")
"""Converts a duration [s]."""

baud_rate = between(9_600, 4_500_000, "bit/s", int)
"""Converts a baud rate."""

servo_id = between(0, 253, "as a servo id", int)
"""Converts the id of a servo."""


def point_in_frame(text: str) -> tuple[tuple[float, float, float], str]:
    """Convert a point [m] and its frame, such as 1,0.5,0@base_link; @frame: its origin."""
    numbers, _, frame_id = text.strip().partition("@")
    try:
        x, y, z = (float(number) for number in (numbers or "0,0,0").split(","))
    except ValueError:
        x = y = z = math.nan
    if not frame_id or not all(map(math.isfinite, (x, y, z))):
        raise ArgumentTypeError(
            f"{text!r} is not a point; give three numbers in metres and a frame, such as "
            "1,0.5,0@base_link"
        )
    return (x, y, z), frame_id


def with_negative_values(arguments: Sequence[str]) -> list[str]:
    """Mark values such as -30deg or -1,0,0@base_link, so that argparse does not read options."""
    return [f" {word}" if re.match(r"-\.?\d", word) else word for word in arguments]


def without_ros_arguments(arguments: Sequence[str]) -> list[str]:
    """Return the arguments that are not between `--ros-args` and `--`, as rclpy does."""
    own, ros = [], False
    for word in arguments:
        if word == "--ros-args":
            ros = True
        elif not ros:
            own.append(word)
        ros = ros and word != "--"
    return own


def named_id(text: str) -> tuple[str, int]:
    """Convert NAME:ID, such as XM430-W350:1 or head_pan:1, to the name and the id."""
    name, _, number = text.rpartition(":")
    if not name:
        raise ArgumentTypeError(f"{text!r} is not NAME:ID, such as XM430-W350:1 or head_pan:1")
    return name, servo_id(number)


def existing_file(text: str) -> Path:
    """Convert the path of an existing file."""
    path = Path(text)
    if not path.is_file():
        problem = "is not a file" if path.exists() else "does not exist"
        raise ArgumentTypeError(f"{text!r} {problem}; give the path of a file")
    return path


def writable_file(text: str) -> Path:
    """Convert the path of a file that can be written; existing contents stay."""
    path = Path(text)
    try:
        check_writable(path)
    except OSError as error:
        raise ArgumentTypeError(
            f"{text!r} cannot be written ({error.strerror}); give a file in a writable folder"
        ) from None
    return path


def read_by(read: Callable[[str], Value], error: type[Exception]) -> Callable[[str], Value]:
    """Return a converter that reports the errors of `read` as those of the command line."""

    def convert(text: str) -> Value:
        try:
            return read(text)
        except error as reason:
            raise ArgumentTypeError(str(reason)) from None

    return convert
