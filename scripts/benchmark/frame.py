"""Alternating rounds, medians and tables for benchmarks."""

import statistics
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

Name = TypeVar("Name")
Measured = TypeVar("Measured")


def in_turns(
    contenders: Mapping[Name, Callable[[], Measured]], rounds: int
) -> dict[Name, list[Measured]]:
    """Measure all contenders in alternating rounds, so that the load of the machine affects all.

    Args:
        contenders: measuring functions by name.
        rounds: number of measurements of each.
    """
    found: dict[Name, list[Measured]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, measure in contenders.items():
            found[name].append(measure())
            report(f"{name}: {found[name][-1]}")
    return found


def medians(results: Iterable[Sequence[float]]) -> list[float]:
    """Return the median of each column of the results."""
    return [statistics.median(column) for column in zip(*results, strict=True)]


def report(text: str) -> None:
    """Print progress to stderr."""
    print(text, file=sys.stderr, flush=True)


def row(*cells: object) -> str:
    """Return a row of a table, and report it."""
    text = f"| {' | '.join(map(str, cells))} |"
    report(text)
    return text


def table(head: str, rows: Iterable[str]) -> str:
    """Return a table in Markdown.

    Args:
        head: the titles of the columns, separated by |.
        rows: made by `row`.
    """
    return "\n".join([f"| {head} |", "|" + "---|" * (head.count("|") + 1), *rows])
