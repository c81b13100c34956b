"""A head that is struck by whatever can happen, for a while: see test/support/chaos.py."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

from frame import report, row, table

PROGRAM = Path(__file__).parents[2] / "test" / "support" / "chaos.py"
SECONDS = 40.0  # of one robot's life
LAYOUTS = (
    ("a composed run", ("--run", "composed")),
    ("a process for each node", ("--run", "nodes")),
    ("a composed run whose clock jumps", ("--run", "composed", "--clock")),
    ("a process for each node, and the clock jumps", ("--run", "nodes", "--clock")),
)


def chaos(minutes: float, seed: int) -> str:
    """The table: one robot after the other, each with a seed of its own, counted up."""
    end = time.monotonic() + 60.0 * minutes
    told: dict[str, list[dict[str, Any]]] = defaultdict(list)
    broken: list[str] = []
    while time.monotonic() < end:
        for name, layout in LAYOUTS:
            command = [sys.executable, str(PROGRAM), "--seed", str(seed), *layout]
            done = subprocess.run(
                [*command, "--seconds", str(SECONDS)], capture_output=True, text=True, check=False
            )
            if done.returncode:
                lines = done.stderr.splitlines() or [f"exit code {done.returncode}"]
                said = next((line for line in lines if line.startswith("chaos ")), lines[-1])
                broken.append(f"- `{said}`")
                report(done.stderr)
            else:
                told[name].append(json.loads(done.stdout))
                report(f"{name} {seed} {done.stdout}")
            seed += 1
    rows = []
    struck: Counter[str] = Counter()
    for name, robots in told.items():
        blows: Counter[str] = sum((Counter(one["struck"]) for one in robots), Counter())
        struck += blows
        rows.append(
            row(
                name,
                len(robots),
                blows.total(),
                sum(one["stops"] for one in robots),
                f"{max(one['slowest_stop'] for one in robots):.2f} s",
                sum(one["recoveries"] for one in robots),
                f"{max(one['slowest_recovery'] for one in robots):.2f} s",
            )
        )
    head = "robot | robots | blows | STOPs | slowest STOP | recoveries | slowest recovery"
    blows_told = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in struck.most_common())
    end_of_list = ":" if broken else "."
    return "\n".join(
        [
            f"{table(head, rows)}\n\nBlows: {blows_told}.\n",
            f"Did not hold {len(broken)} times{end_of_list}",
            *broken,
        ]
    )
