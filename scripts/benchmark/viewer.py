"""What the viewer costs the control loop: alone, with a recording, with three browsers."""

from __future__ import annotations

import math
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

from frame import in_turns, medians, row, table
from simulated_run import SimulatedRun, own_domain, processor_time

SUPPORT = Path(__file__).parents[2] / "test" / "support"
SECONDS = 20
ROUNDS = 3
BROWSERS = 3

READERS = """
import sys, threading
sys.path.insert(0, {support!r})
from viewer_client import ReadingClient
clients = [ReadingClient({port}) for _ in range({count})]
print("watching", flush=True)
sys.stdin.read()
for client in clients:
    client.close()
"""
CHROMIUM = """
import sys
sys.path.insert(0, {support!r})
from browser import open_browser, open_page
with open_browser() as browser:
    for _ in range({count}):
        open_page(browser, {port})
    print("watching", flush=True)
    sys.stdin.read()
"""

RECORDER = """
import subprocess, sys, tempfile
with tempfile.TemporaryDirectory() as folder:
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "head_tracking.ros.robot.recorder", "--ros-args", "-p",
         "record_directory:=" + folder],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    while "records into" not in process.stdout.readline():
        pass
    print("watching", flush=True)
    sys.stdin.read()
    process.terminate()
    print(process.communicate()[0], file=sys.stderr)
"""


class Measured(NamedTuple):
    """One run."""

    rate: float
    rms: float
    largest: float
    processor: float


@contextmanager
def watching(script: str, port: int) -> Iterator[None]:
    """Browsers, or what takes their place, in a process that the others go before."""
    code = script.format(support=str(SUPPORT), port=port, count=BROWSERS)
    process = subprocess.Popen(
        ["nice", "-n", "19", sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdin is not None
    try:
        if "watching" not in process.stdout.readline():
            raise SystemExit("the browsers did not start; see above")
        yield
    finally:
        process.stdin.close()
        process.wait()


def measure(arguments: list[str], script: str | None) -> Measured:
    """Runs a simulated head for a while, and counts from when everybody watches."""
    with SimulatedRun(*arguments) as run, ExitStack() as resources:
        if script is not None:
            resources.enter_context(watching(script, run.port))
        before, used = len(run.told), processor_time(run.control_pid)
        time.sleep(SECONDS)
        used = processor_time(run.control_pid) - used
        told = run.told[before:]
    rms = math.sqrt(statistics.fmean(one.error**2 for one in told))
    return Measured(
        statistics.fmean(one.rate for one in told),
        rms,
        max(one.error for one in told),
        used / SECONDS,
    )


VARIANTS: tuple[tuple[str, list[str], str | None], ...] = (
    ("without the viewer", [], None),
    ("with the viewer, nobody watches", ["--viewer"], None),
    ("everything is recorded", [], RECORDER),
    (f"{BROWSERS} clients that read all and draw nothing", ["--viewer"], READERS),
    (f"{BROWSERS} pages in Chromium on the same two cores", ["--viewer"], CHROMIUM),
)


def viewer() -> str:
    """The table: medians of several rounds in which all variants take turns."""
    own_domain()
    found = in_turns({name: partial(measure, *variant) for name, *variant in VARIANTS}, ROUNDS)
    rows = []
    for name, runs in found.items():
        rate, rms, largest, processor = medians(runs)
        share = f"{100 * processor:.0f} % of a core"
        rows.append(row(name, f"{rate:.1f}", f"{rms:.2f}°", f"{largest:.1f}°", share))
    return table(
        "who watches | bus cycles a second | error rms | error max | the robot's process", rows
    )
