"""What a check has found, and how it is told."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TextIO


class Level(IntEnum):
    """How bad it is; the worst one is the exit code, as monitoring plugins have it."""

    SKIPPED = -1
    GREEN = 0
    AMBER = 1
    RED = 2


@dataclass(frozen=True, slots=True)
class Finding:
    """What a check has found.

    Attributes:
        check: what was looked at.
        level: how bad it is.
        text: what was found.
        cure: what to do about it; empty where all is well.
    """

    check: str
    level: Level
    text: str
    cure: str = ""


_WORDS: Final = {
    Level.SKIPPED: ("-", ""),
    Level.GREEN: ("green", "32"),
    Level.AMBER: ("amber", "33"),
    Level.RED: ("red", "31"),
}
_MARGIN: Final = 25


def exit_code(findings: Iterable[Finding]) -> int:
    """0 if all is green, 1 if something is amber, 2 if something is red."""
    return max(0, *(finding.level for finding in findings), 0)


def tell(finding: Finding, output: TextIO) -> None:
    """Print a finding, in colour on a terminal."""
    word, colour = _WORDS[finding.level]
    word = f"{word:5}"
    if colour and output.isatty() and "NO_COLOR" not in os.environ:
        word = f"\033[{colour}m{word}\033[0m"
    print(f"{word}  {finding.check:{_MARGIN - 8}} {finding.text}", file=output)
    if finding.cure:
        print(f"{'':{_MARGIN}} -> {finding.cure}", file=output)
