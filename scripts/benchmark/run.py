"""The fictitious target in a whole run, followed with the tutorials' values and with ours."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
import tempfile

TUTORIAL = """\
/**/head_tracker:
  ros__parameters: {law: speed, rate: 10, k_pan: 1.5, k_tilt: 1.5, max_joint_speed: %s}
"""


def run() -> str:
    """The fictitious target in a whole run, followed with the tutorials' values and with ours."""
    rows = [
        _follow(robot, name, parameters)
        for robot in ("kinectbot", "turtlebot")
        for name, parameters in (
            ("tutorials' (k 1.5, 0.5 rad/s, 10 Hz)", TUTORIAL % 0.5),
            ("tutorials', faster (k 1.5, 2.0 rad/s, 10 Hz)", TUTORIAL % 2.0),
            ("config/head.yaml (law predictive, 50 Hz)", ""),
        )
    ]
    head_row = "| robot | values | error rms | error max | bus cycles | faults | processor |"
    return "\n".join([head_row, "|---|---|---|---|---|---|---|", *rows])


def _follow(robot: str, name: str, parameters: str) -> str:
    seconds = 20
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(parameters or "/**:\n  ros__parameters: {use_sim_time: false}\n")
        file.flush()
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        finished = subprocess.run(
            [
                *(sys.executable, "-m", "head_tracking", "--sim", "--robot", robot),
                *("--duration", str(seconds), "--params", file.name),
            ],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
            env=os.environ,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    summary = finished.stdout.splitlines()[-1]
    found = re.search(r"error ([\d.]+)° rms, ([\d.]+)° max.*; (\d+) bus cycles, (\d+)", summary)
    assert found is not None, summary
    rms, largest, cycles, faults = found.groups()
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return (
        f"| {robot} | {name} | {rms}° | {largest}° | {cycles} | {faults} | "
        f"{100 * used / seconds:.0f} % of a core |"
    )
