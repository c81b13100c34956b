"""The page in Chromium: time from STOP to its answer; processor time and memory over time."""

import os
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from browser import open_browser, open_page, open_tab
from frame import row, table
from rig import child
from simulated_run import (
    command,
    descendants,
    memory,
    processor_time,
    run_with_page,
)

SAMPLES = 8
FIRST = 2.0  # minutes until all buffers are full
SETTLING = 4.0  # s

# floods the page with one kind of request, from 20 connections
FLOOD = """
import http.client, sys, threading
def flood():
    while True:
        try:
            client = http.client.HTTPConnection("127.0.0.1", int(sys.argv[1]), timeout=30)
            while True:
                client.request(*sys.argv[2:4], sys.argv[4], {"X-Head-Tracking": "page"})
                client.getresponse().read()
        except (OSError, http.client.HTTPException):
            pass
for _ in range(20):
    threading.Thread(target=flood).start()
"""
FLOODS = {
    "nobody else": (),
    "20 clients change the mode": ("POST", "/head/do/mode", '{"mode": "track"}'),
    "20 clients ask for the parameters": ("GET", "/head/parameters", ""),
    "20 clients press STOP": ("POST", "/head/stop", ""),
}
STOPS = 100
PRESS_STOP = """async () => {
  const start = performance.now();
  await headPage.stop();
  const took = performance.now() - start;
  const about = { method: "POST", headers: { "X-Head-Tracking": "page" }, body: "{}" };
  for (let done = false, left = 50; !done && left; left -= 1)
    done = (await (await fetch("/head/resume", about)).json()).done;
  await new Promise((end) => setTimeout(end, 100));
  return took;
}"""


def stopped() -> str:
    """Return a table of the time from the click on STOP to its answer, beside floods."""
    rows = []
    with run_with_page() as (_, port), open_browser() as browser:
        page = open_page(browser, port, 1280, 800)
        for name, request in FLOODS.items():
            with _flood(port, *request):
                page.wait_for_timeout(1e3 * SETTLING)
                times = [page.evaluate(PRESS_STOP) for _ in range(STOPS)]
            percentiles = statistics.quantiles(times, n=100)
            rows.append(row(name, *(f"{percentiles[n - 1]:.0f} ms" for n in (50, 99))))
    return table("beside | p50 | p99", rows)


@contextmanager
def _flood(port: int, *request: str) -> Iterator[None]:
    arguments = ["-c", FLOOD, str(port), *request] if request else ["-c", ""]
    process = subprocess.Popen([sys.executable, *arguments])
    try:
        yield
    finally:
        process.kill()
        process.wait()


class Sample(NamedTuple):
    """Totals up to a moment [s]."""

    at: float
    viewer: float
    told: int


def left_open(minutes: float) -> str:
    """Return a table with a row for each part of the time; a browser watches a tracking head."""
    rows = []
    with run_with_page() as (run, port), open_browser() as browser:
        viewer, control = (child(run.process.pid, name) for name in ("page", "control"))
        page = open_page(browser, port, 600, 500)
        open_tab(page, "health")  # with the most changes
        debugger = page.context.new_cdp_session(page)
        debugger.send("Performance.enable")
        start = time.monotonic()

        def sample() -> Sample:
            return Sample(time.monotonic(), processor_time(viewer), len(run.output))

        before = sample()
        for number in range(SAMPLES + 1):
            due = start + 60.0 * (FIRST + number * (minutes - FIRST) / SAMPLES)
            page.wait_for_timeout(1e3 * max(0.0, due - time.monotonic()))
            now = sample()
            debugger.send("HeapProfiler.collectGarbage")
            heap, nodes = _page_memory(debugger)
            renderers = [
                pid for pid in descendants(os.getpid()) if b"--type=renderer" in command(pid)
            ]
            seconds = now.at - before.at
            rates = map(int, re.findall(r"\| bus (\d+) Hz", run.output[before.told :]))
            rows.append(
                row(
                    f"{(now.at - start) / 60:.1f}",
                    f"{memory(viewer):.1f}",
                    *(len(os.listdir(f"/proc/{viewer}/{name}")) for name in ("task", "fd")),
                    f"{100 * (now.viewer - before.viewer) / seconds:.1f} % of a core",
                    f"{heap:.1f}",
                    nodes,
                    f"{sum(map(memory, renderers)):.0f}",
                    f"{memory(control):.1f}",
                    f"{statistics.fmean(rates):.1f}",
                )
            )
            before = now
    return table(
        "minute | viewer: memory, MB | threads | file descriptors | processor | page: JS heap, "
        "MB | DOM nodes | process, MB | robot: memory, MB | bus cycles a second", rows
    )  # fmt: skip


def _page_memory(debugger: Any) -> tuple[float, int]:
    """Return the JavaScript heap after a collection [MB], and the number of DOM nodes."""
    metrics = debugger.send("Performance.getMetrics")["metrics"]
    found = {one["name"]: one["value"] for one in metrics}
    return found["JSHeapUsedSize"] / 1e6, int(found["Nodes"])
