"""A whole run by the wall clock: how well it follows, what it takes, and how soon it answers.

Everything that is compared takes turns in one run, and medians are shown.
"""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from frame import medians, report, row, table
from reacting_servos import LEAD
from simulated_run import descendants, memory, processor_time

HERE = Path(__file__).parent
SECONDS = 20
WARM_UP = 6.0  # s; until then a run sets itself up, and looks whether it is alone
ROUNDS = 3
TUTORIAL = """\
/**/head_tracker:
  ros__parameters: {law: speed, rate: 10, k_pan: 1.5, k_tilt: 1.5, max_joint_speed: %s}
"""
# slow, so that the head is under way all the time
TELLING = """\
/**/head_tracker:
  ros__parameters: {law: speed, lead_target_angle: %s, max_joint_speed: 0.03}
"""
FAR = "1,2.5,2.2@base_link"


class Followed(NamedTuple):
    """What a run says of itself at its end.

    Attributes:
        rms: [degrees].
        largest: [degrees].
        cycles: of the bus.
        faults: of the bus.
    """

    rms: float
    largest: float
    cycles: int
    faults: int


class Taken(NamedTuple):
    """What a program with all of its processes took.

    Attributes:
        processor: of one core.
        memory: of the program itself, and of its largest process [MB].
    """

    processor: float
    memory: tuple[float, float]


def run() -> str:
    """All tables."""
    return "\n\n".join((_following(), _costs()))


def _following() -> str:
    """How well whole runs follow their targets, judged by the true angles."""
    variants = {
        (robot, "fictitious", name): (robot, "fictitious", parameters)
        for robot in ("kinectbot", "turtlebot")
        for name, parameters in (
            ("tutorials' (k 1.5, 0.5 rad/s, 10 Hz)", TUTORIAL % 0.5),
            ("tutorials', faster (k 1.5, 2.0 rad/s, 10 Hz)", TUTORIAL % 2.0),
            ("as shipped", ""),
        )
    }
    for target in ("face", "ball"):
        variants["kinectbot", target, "as shipped"] = ("kinectbot", target, "")
    found: dict[Any, list[Followed]] = defaultdict(list)
    for turn in range(ROUNDS):
        for name, (robot, target, parameters) in variants.items():
            if turn and parameters:
                continue  # the tutorials' values are so far off that once is enough
            found[name].append(_follow(robot, target, parameters))
            report(f"{name}: {found[name][-1]}")
    rows = []
    for (robot, target, values), runs in found.items():
        each = ", ".join(f"{one.rms:.2f}" for one in runs)
        rms, largest, cycles, _ = medians(runs)
        faults = sum(one.faults for one in runs)
        rows.append(
            row(
                robot,
                target,
                values,
                f"{rms:.2f}°",
                each,
                f"{largest:.2f}°",
                f"{cycles:.0f}",
                faults,
            )
        )
    return table(
        "robot | target | values | error rms | of each run | error max | bus cycles | faults", rows
    )


def _follow(robot: str, target: str, parameters: str) -> Followed:
    with _parameter_file(parameters) as file:
        finished = subprocess.run(
            [
                *(sys.executable, "-m", "head_tracking", "--sim", "--robot", robot),
                *("--target", target, "--duration", str(SECONDS), *file),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            check=True,
            env=os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        )
    summary = finished.stdout.splitlines()[-1]
    said = re.search(r"error ([\d.]+)° rms, ([\d.]+)° max.*; (\d+) bus cycles, (\d+)", summary)
    assert said is not None, summary
    rms, largest, cycles, faults = said.groups()
    return Followed(float(rms), float(largest), int(cycles), int(faults))


def _costs() -> str:
    """Processor time and memory beside a bare node's, the way of a reading, and the start."""
    bare, whole, driver = [], [], []
    next_packet: list[list[float]] = []
    answers: list[list[float]] = []
    starts = []
    for turn in range(ROUNDS):
        bare.append(_take(str(HERE / "bare_node.py")))
        whole.append(_take("-m", "head_tracking", "--sim"))
        with _servos() as (port, told):
            started = time.monotonic_ns()
            driver.append(_take("-m", "head_tracking", "--port", port, "--target", "fictitious"))
        next_packet.append(told["next"])
        if turn:  # the first start also reads the files from the disk
            starts.append((told["first"] - started) * 1e-9)
        with _servos("shaking") as (port, told), _parameter_file(TELLING % LEAD) as file:
            _take("-m", "head_tracking", "--port", port, "--target", FAR, *file)
        answers.append(told["answers"])
        report(
            f"{bare[-1]} {whole[-1]} {driver[-1]} {_milliseconds(next_packet[-1:])} "
            f"{_milliseconds(answers[-1:])} {starts[-1:]}"
        )
    ratios = [
        [one.processor / base.processor for one, base in zip(runs, bare, strict=True)]
        for runs in (whole, driver)
    ]
    base = statistics.median(one.processor for one in bare)
    bare_memory = statistics.median(one.memory[0] for one in bare)
    rows = [
        f"| processor time of {what}, over a bare node's ({100 * base:.1f} % of a core) | "
        f"**{statistics.median(ratio):.1f}** ({min(ratio):.1f} to {max(ratio):.1f}): "
        f"{100 * statistics.median(one.processor for one in runs):.0f} % of a core | {asked} |"
        for what, runs, ratio, asked in (
            ("a simulated run", whole, ratios[0], 4),
            ("the same with the servos simulated in another process", driver, ratios[1], 3),
        )
    ]
    rows += [
        "| from a reading's last byte to the packet made from it, law speed: p50, p99, largest | "
        f"{_milliseconds(answers)} | 1 ms, 3 ms |",
        "| from a reading's last byte to the next packet of goals, law predictive: p50, p99, "
        f"largest | {_milliseconds(next_packet)} | |",
        f"| memory of the control process; a bare node's is {bare_memory:.0f} MB | "
        f"{statistics.median(one.memory[1] for one in whole):.0f} MB | 90 MB |",
        "| memory of the supervisor | "
        f"{statistics.median(one.memory[0] for one in whole):.0f} MB | 20 MB |",
        "| warm start, from the command to the first packet on the wire | "
        f"{statistics.median(starts):.2f} s ({max(starts):.2f} s at most) | 1.5 s |",
    ]
    return table("what | measured | asked", rows)


def _take(*arguments: str) -> Taken:
    """What a Python program takes between its warming up and its end by SIGTERM."""
    process = subprocess.Popen(
        [sys.executable, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        time.sleep(WARM_UP)
        pids = [process.pid, *descendants(process.pid)]
        before, start = sum(map(processor_time, pids)), time.monotonic()
        time.sleep(SECONDS)
        used = sum(map(processor_time, pids)) - before
        largest = max(map(memory, pids))
        return Taken(used / (time.monotonic() - start), (memory(process.pid), largest))
    finally:
        process.terminate()
        process.wait()


@contextmanager
def _servos(*arguments: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Servos in a process of their own: their port, and after the block what they tell."""
    program = [sys.executable, str(HERE / "reacting_servos.py"), *arguments]
    told: dict[str, Any] = {}
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip(), told
        finally:
            process.terminate()
            told.update(json.loads(process.stdout.read() or "{}"))


@contextmanager
def _parameter_file(parameters: str) -> Iterator[tuple[str, ...]]:
    """The arguments for parameters in YAML, if there are any."""
    if not parameters:
        yield ()
        return
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(parameters)
        file.flush()
        yield "--params", file.name


def _milliseconds(rounds: Sequence[Sequence[float]]) -> str:
    """Medians of the rounds' percentiles."""
    percentiles = [
        [1e3 * sorted(times)[int(share * (len(times) - 1))] for share in (0.5, 0.99, 1.0)]
        for times in rounds
        if times
    ]
    if not percentiles:
        return "-"
    middle, high, largest = (statistics.median(column) for column in zip(*percentiles, strict=True))
    return f"{middle:.2f} ms, {high:.2f} ms, {largest:.1f} ms"
