"""Whole runs in real time: tracking error, processor time, memory, reaction time and start time.

Everything that is compared is measured in alternating rounds; the tables have medians.
"""

import os
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from frame import in_turns, medians, row, table
from servos import elsewhere
from simulated_run import descendants, memory, processor_time

HERE = Path(__file__).parent
SECONDS = 20
WARM_UP = 6.0  # s until a run has started all of its nodes
ROUNDS = 5
LOCAL = os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}  # for several processes


class Summary(NamedTuple):
    """The summary of a run: error [degrees], bus cycles and faults."""

    rms: float
    largest: float
    cycles: int
    faults: int


class Cost(NamedTuple):
    """Processor time of a program with its children [cores], and memory [MB]."""

    processor: float  # of all processes
    memory: float  # of the program itself
    largest: float  # memory of its largest process


def run() -> str:
    """Return all tables."""
    return f"{_errors()}\n\n{_costs()}"


def _errors() -> str:
    """Return the table of tracking errors, by the true angles."""
    runs = [(robot, "fictitious") for robot in ("kinectbot", "turtlebot")]
    runs += [("kinectbot", target) for target in ("face", "ball")]
    results = in_turns({names: partial(_follow, *names) for names in runs}, ROUNDS)
    rows = []
    for names, found in results.items():
        rms, largest, cycles, _ = medians(found)
        each = ", ".join(f"{one.rms:.2f}" for one in found)
        faults = sum(one.faults for one in found)
        rows.append(row(*names, f"{rms:.2f}°", each, f"{largest:.2f}°", f"{cycles:.0f}", faults))
    return table("robot | target | error rms | of each run | error max | bus cycles | faults", rows)


def _follow(robot: str, target: str) -> Summary:
    command = [sys.executable, "-m", "head_tracking", "--sim", "--robot", robot]
    command += ["--target", target, "--duration", str(SECONDS)]
    finished = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        check=True,
        env=LOCAL,
    )
    summary = finished.stdout.splitlines()[-1]
    match = re.search(r"error ([\d.]+)° rms, ([\d.]+)° max.*; (\d+) bus cycles, (\d+)", summary)
    assert match is not None, summary
    rms, largest, cycles, faults = match.groups()
    return Summary(float(rms), float(largest), int(cycles), int(faults))


def _costs() -> str:
    """Return the table of costs, reaction times and start times."""
    next_packets: list[list[float]] = []
    starts: list[float] = []

    def with_servos_elsewhere() -> Cost:
        with elsewhere() as (port, _, times):
            start = time.monotonic_ns()
            cost = _measure("-m", "head_tracking", "--port", port, "--target", "fictitious")
        next_packets.append(times["next"])
        starts.append((times["first"] - start) * 1e-9)
        return cost

    simulated = ("-m", "head_tracking", "--sim")
    found = in_turns(
        {
            "bare node": lambda: _measure(str(HERE / "bare_node.py")),
            "a simulated run": lambda: _measure(*simulated),
            "the same with simulated servos in another process": with_servos_elsewhere,
            "a simulated run with a face": lambda: _measure(*simulated, "--target", "face"),
        },
        ROUNDS,
    )
    bare, run = found.pop("bare node"), found["a simulated run"]
    del starts[0]  # the first start also reads files from the disk
    base = 100.0 * statistics.median(one.processor for one in bare)
    rows = []
    for (name, costs), limit in zip(found.items(), (5, 3, 8), strict=True):
        ratios = [one.processor / b.processor for one, b in zip(costs, bare, strict=True)]
        percent = 100.0 * statistics.median(one.processor for one in costs)
        rows.append(
            row(
                f"processor time of {name}, over a bare node's ({base:.1f} % of a core)",
                f"**{statistics.median(ratios):.1f}** ({min(ratios):.1f} to {max(ratios):.1f}): "
                f"{percent:.0f} % of a core",
                limit,
            )
        )
    bare_memory = statistics.median(one.memory for one in bare)
    rows += [
        row(
            "from the last byte of a reading to the next packet of goals: p50, p99, largest",
            _milliseconds(next_packets),
            "0.7 ms, 1.8 ms",
        ),
        row(
            f"memory of the control process; a bare node's is {bare_memory:.0f} MB",
            f"{statistics.median(one.largest for one in run):.0f} MB",
            "90 MB",
        ),
        row(
            "memory of the supervisor",
            f"{statistics.median(one.memory for one in run):.0f} MB",
            "20 MB",
        ),
        row(
            "warm start, from the command to the first packet on the wire",
            f"{statistics.median(starts):.2f} s ({max(starts):.2f} s at most)",
            "1.5 s",
        ),
    ]
    return table("quantity | measured | limit", rows)


def _measure(*arguments: str) -> Cost:
    """Return the cost of a Python program between its warm-up and SIGTERM."""
    process = subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=LOCAL,
    )
    try:
        time.sleep(WARM_UP)
        before = {pid: processor_time(pid) for pid in (process.pid, *descendants(process.pid))}
        start = time.monotonic()
        time.sleep(SECONDS)
        pids = before.keys() & {process.pid, *descendants(process.pid)}  # without short-lived ones
        used = sum(processor_time(pid) - before[pid] for pid in pids)
        processor = used / (time.monotonic() - start)
        return Cost(processor, memory(process.pid), max(map(memory, pids)))
    finally:
        process.terminate()
        process.wait()


def _milliseconds(rounds: Sequence[Sequence[float]]) -> str:
    """Return the medians of the percentiles of each round."""
    percentiles = [
        [1e3 * sorted(times)[int(share * (len(times) - 1))] for share in (0.5, 0.99, 1.0)]
        for times in rounds
        if times
    ]
    if not percentiles:
        return "-"
    middle, high, largest = medians(percentiles)
    return f"{middle:.2f} ms, {high:.2f} ms, {largest:.1f} ms"
