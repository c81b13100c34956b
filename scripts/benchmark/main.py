"""Benchmarks of head_tracking; each makes one table of docs/results.md."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path

from bus import bus
from chaos import chaos
from faces import faces
from interfaces import interfaces
from network import network
from page import fluidity, left_open
from pointing import pointing
from run import run
from soak import soak
from tracking import tracking
from transforms import transforms
from viewer import viewer
from vision import vision

RESULTS = Path(__file__).parents[2] / "docs" / "results.md"

BENCHMARKS: dict[str, Callable[[], str]] = {
    "bus": bus,
    "faces": faces,
    "interfaces": interfaces,
    "network": network,
    "pointing": pointing,
    "run": run,
    "tracking": tracking,
    "transforms": transforms,
    "viewer": viewer,
    "viewer-fluid": fluidity,
    "vision": vision,
}


def write(name: str, table: str) -> None:
    """Puts the table between its marks in docs/results.md."""
    text = RESULTS.read_text()
    marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    assert marks.search(text), f"{RESULTS} has no place for {name}"
    RESULTS.write_text(marks.sub(lambda match: f"{match[1]}{table}\n{match[2]}", text))


def main() -> None:
    """Runs one benchmark and writes its table."""
    parser = argparse.ArgumentParser(prog="scripts/benchmark/measure", description=__doc__)
    parser.add_argument("name", choices=sorted([*BENCHMARKS, "chaos", "soak"]))
    parser.add_argument(
        "--minutes",
        type=float,
        help="of soak and chaos (default: 10), or how long to leave the viewer's page open "
        "instead of measuring what it costs",
    )
    parser.add_argument("--seed", type=int, default=1, help="of chaos (default: 1)")
    options = parser.parse_args()
    name, minutes = options.name, options.minutes
    if name == "soak":
        table = soak(minutes or 10.0)
    elif name == "chaos":
        table = chaos(minutes or 10.0, options.seed)
    elif name == "viewer" and minutes:
        name, table = "viewer-open", left_open(minutes)
    else:
        table = BENCHMARKS[name]()
    print(table)
    write(name, table)


if __name__ == "__main__":
    main()
