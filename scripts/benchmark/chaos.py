"""Random faults in a running head: see test/support/chaos.py."""

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
SECONDS = 40.0  # for each robot
LAYOUTS = (
    ("a run", ("--run", "composed")),
    ("a process for each node", ("--run", "nodes")),
    ("a run, the clock jumps", ("--run", "composed", "--clock")),
    ("a process for each node, the clock jumps", ("--run", "nodes", "--clock")),
)


def chaos(minutes: float, seed: int) -> str:
    """Return the table of robots that were tested one after the other, each with its own seed."""
    end = time.monotonic() + 60.0 * minutes
    results: dict[str, list[dict[str, Any]]] = defaultdict(list)
    violations: list[str] = []
    while time.monotonic() < end:
        for name, layout in LAYOUTS:
            command = [sys.executable, str(PROGRAM), "--seed", str(seed), *layout]
            done = subprocess.run(
                [*command, "--seconds", str(SECONDS)], capture_output=True, text=True, check=False
            )
            if done.returncode:
                lines = done.stderr.splitlines() or [f"exit code {done.returncode}"]
                first = next((line for line in lines if line.startswith("chaos ")), lines[-1])
                violations.append(f"- `{first}`")
                report(done.stderr)
            else:
                results[name].append(json.loads(done.stdout))
                report(f"{name} {seed} {done.stdout}")
            seed += 1
    faults: Counter[str] = Counter()
    rows = []
    for name, robots in results.items():
        of_layout: Counter[str] = sum((Counter(one["faults"]) for one in robots), Counter())
        faults += of_layout
        rows.append(
            row(
                name,
                len(robots),
                of_layout.total(),
                sum(one["stops"] for one in robots),
                f"{max(one['slowest_stop'] for one in robots):.2f} s",
                sum(one["recoveries"] for one in robots),
                f"{max(one['slowest_recovery'] for one in robots):.2f} s",
            )
        )
    head = "robot | robots | faults | STOPs | slowest STOP | recoveries | slowest recovery"
    listed = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in faults.most_common())
    return "\n".join(
        [
            f"{table(head, rows)}\n\nFaults: {listed}.\n",
            f"Violated conditions: {len(violations)}{':' if violations else '.'}",
            *violations,
        ]
    )
