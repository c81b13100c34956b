"""What the benchmarks share: rounds in which all contenders take turns, and tables."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

Measured = TypeVar("Measured")


def in_turns(
    contenders: Mapping[str, Callable[[], Measured]], rounds: int
) -> dict[str, list[Measured]]:
    """Measure all contenders, round after round, and report each result at once.

    So all of them see the machine in all its moods.
    """
    found: dict[str, list[Measured]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, measure in contenders.items():
            found[name].append(measure())
            report(f"{name}: {found[name][-1]}")
    return found


def medians(results: Iterable[Sequence[float]]) -> list[float]:
    """Return the median of each column of some results."""
    return [statistics.median(column) for column in zip(*results, strict=True)]


def report(text: str) -> None:
    """Show what was measured while the benchmark goes on."""
    print(text, file=sys.stderr, flush=True)


def row(*cells: object) -> str:
    """Return a row of a table, after it has been reported."""
    text = f"| {' | '.join(map(str, cells))} |"
    report(text)
    return text


def table(head: str, rows: Iterable[str]) -> str:
    """Return a table in Markdown.

    Args:
        head: the titles of the columns, with | between them.
        rows: as `row` makes them.
    """
    return "\n".join([f"| {head} |", "|" + "---|" * (head.count("|") + 1), *rows])
