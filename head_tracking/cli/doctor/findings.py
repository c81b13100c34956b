"""The result of a check of doctor."""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

from rich.table import Table
from rich.text import Text

from head_tracking.cli.terminal import Terminal


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


_COLOURS: Final = {Grade.GREEN: "green", Grade.AMBER: "yellow", Grade.RED: "red"}


def show(finding: Finding) -> None:
    """Print a finding, in colour on a terminal."""
    row = Table.grid(padding=(0, 2))
    row.add_column(width=5, style=_COLOURS.get(finding.level, ""))
    row.add_column(width=17)
    row.add_column()
    word = "-" if finding.level is Grade.SKIPPED else finding.level.name.lower()
    row.add_row(word, finding.check, Text(finding.text))
    Terminal().show(row)
