"""The result of a check of doctor."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from enum import IntEnum
from typing import Final, NamedTuple


class Grade(IntEnum):
    """Severity of a finding; the highest is the exit code."""

    SKIPPED = -1
    GREEN = 0
    AMBER = 1
    RED = 2


class Finding(NamedTuple):
    """The result of a check: its name, severity, what was found, and what to do about it."""

    check: str
    level: Grade
    text: str


_INDENT: Final = 25  # columns before the text
_SHORTEST: Final = 20  # columns of the text
_COLOURS: Final = {Grade.GREEN: "32", Grade.AMBER: "33", Grade.RED: "31"}


def show(finding: Finding) -> None:
    """Print a finding, in colour on a terminal."""
    level, colour = finding.level, _COLOURS.get(finding.level)
    word = f"{'-' if level is Grade.SKIPPED else level.name.lower():5}"
    if colour and sys.stdout.isatty() and "NO_COLOR" not in os.environ:
        word = f"\033[{colour}m{word}\033[0m"
    text = finding.text
    if sys.stdout.isatty():
        width = max(_SHORTEST, shutil.get_terminal_size().columns - _INDENT)
        lines = textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)
        text = f"\n{' ' * _INDENT}".join(lines)
    print(f"{word}  {finding.check:17} {text}", flush=True)
