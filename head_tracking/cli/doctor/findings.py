"""The result of a check of doctor."""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TextIO


class Grade(IntEnum):
    """Severity of a finding; the highest is the exit code."""

    SKIPPED = -1
    GREEN = 0
    AMBER = 1
    RED = 2


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of a check.

    Attributes:
        check: name of the check.
        level: severity.
        text: what was found, and what to do about it.
    """

    check: str
    level: Grade
    text: str


_COLOURS: Final = {Grade.GREEN: "32", Grade.AMBER: "33", Grade.RED: "31"}


def show(finding: Finding, output: TextIO) -> None:
    """Print a finding, in colour on a terminal."""
    level, colour = finding.level, _COLOURS.get(finding.level)
    word = f"{'-' if level is Grade.SKIPPED else level.name.lower():5}"
    if colour and output.isatty() and "NO_COLOR" not in os.environ:
        word = f"\033[{colour}m{word}\033[0m"
    print(f"{word}  {finding.check:17} {finding.text}", file=output, flush=True)
