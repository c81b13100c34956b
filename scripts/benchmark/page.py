"""The page in Chromium: states and frames per second, processor time, memory over time."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from browser import open_browser, open_page, open_tab
from frame import in_turns, medians, row, table
from simulated_run import (
    SimulatedRun,
    command,
    descendants,
    file_descriptors,
    memory,
    own_domain,
    processor_time,
    threads,
)
from sixty_links import ARM, sixty_links
from viewer_client import ReadingClient

from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model

SAMPLES = 8
FIRST = 2.0  # minutes until the buffer of the last minute is full
ROUNDS = 3
SETTLING, SECONDS = 4.0, 10.0

# publishes the joints of the arms, as their driver would
MOVER = """
import math, time, rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node("arms")
sender = node.create_publisher(JointState, "arm_states", 10)
names = ["{joint}%d" % i for i in range(45)]
start = time.monotonic()
def send():
    now = time.monotonic() - start
    message = JointState(name=names, position=[0.5 * math.sin(now + i) for i in range(45)])
    message.header.stamp = node.get_clock().now().to_msg()
    sender.publish(message)
node.create_timer(0.02, send)
try:
    rclpy.spin(node)
except rclpy.executors.ExternalShutdownException:
    pass
"""
SOURCES = """\
/**/joint_state_publisher:
  ros__parameters: {source_list: [servo_states, arm_states]}
"""

COUNT_FRAMES = """() => {
  const info = window.headPage.scene.renderer.info.render;
  window.frameCount = {offered: 0, drawn: 0};
  let last = info.frame;
  const tick = () => {
    window.frameCount.offered += 1;
    if (info.frame !== last) window.frameCount.drawn += 1;
    last = info.frame;
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}"""
COUNTED = "({...window.frameCount})"


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
    "20 clients save the last minute": ("GET", "/head/last-minute.mcap", ""),
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


class Fluidity(NamedTuple):
    """The rates of one round.

    Attributes:
        read: states per second received by a client that draws nothing.
        drawn: frames per second drawn by a browser.
        offered: frames per second that the browser offered (requestAnimationFrame).
        viewer: processor time of the page while the client read [fraction of a core].
    """

    read: float
    drawn: float
    offered: float
    viewer: float


def fluidity() -> str:
    """Return a table for 15 and 60 links, which take turns; medians of the rounds."""
    with tempfile.TemporaryDirectory() as folder:
        small = load_robot_model(robot_file("kinectbot"))
        sources, urdf = Path(folder, "sources.yaml"), Path(folder, "sixty_links.urdf")
        sources.write_text(SOURCES)
        urdf.write_text(sixty_links(small, visible=True).urdf)
        variants = {
            "15 links, 2 joints move": "kinectbot",
            "60 links, 47 joints move": str(urdf),
        }
        found = in_turns(
            {name: partial(_fluidity, robot, sources) for name, robot in variants.items()}, ROUNDS
        )
    rows = []
    for name, runs in found.items():
        *rates, viewer = medians(runs)
        rows.append(
            row(name, *(f"{rate:.1f}" for rate in rates), f"{100 * viewer:.0f} % of a core")
        )
    return table(
        "robot | states a second, read only | frames drawn a second | frames offered a second | "
        "the viewer's process", rows
    )  # fmt: skip


def _fluidity(robot: str, sources: Path) -> Fluidity:
    own_domain()
    with ExitStack() as resources:
        if robot != "kinectbot":
            resources.enter_context(_arms())
        run = resources.enter_context(
            SimulatedRun("--viewer", "--robot", robot, "--params", str(sources))
        )
        read, viewer = _read_only(run)
        browser = resources.enter_context(open_browser())
        page = open_page(browser, run.port)
        page.evaluate(COUNT_FRAMES)
        page.wait_for_timeout(1e3 * SETTLING)
        before, start = page.evaluate(COUNTED), time.monotonic()
        page.wait_for_timeout(1e3 * SECONDS)
        after, seconds = page.evaluate(COUNTED), time.monotonic() - start
        rate = {name: (after[name] - before[name]) / seconds for name in after}
        return Fluidity(read, rate["drawn"], rate["offered"], viewer)


def _read_only(run: SimulatedRun) -> tuple[float, float]:
    """Return states per second for a client that draws nothing, and the page's processor time."""
    client = ReadingClient(run.port, keep=True)
    try:
        time.sleep(SETTLING)
        client.messages.clear()
        used, start = processor_time(run.viewer_pid), time.monotonic()
        time.sleep(SECONDS)
        seconds = time.monotonic() - start
        updates = client.named("state")
        return len(updates) / seconds, (processor_time(run.viewer_pid) - used) / seconds
    finally:
        client.close()


@contextmanager
def _arms() -> Iterator[None]:
    process = subprocess.Popen([sys.executable, "-c", MOVER.format(joint=ARM)])
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def stopped() -> str:
    """Return a table of the time from the click on STOP to its answer, beside floods."""
    own_domain()
    rows = []
    with SimulatedRun("--viewer") as run, open_browser() as browser:
        page = open_page(browser, run.port, 1280, 800)
        for name, request in FLOODS.items():
            with _flood(run.port, *request):
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
    own_domain()
    rows = []
    with SimulatedRun("--viewer") as run, open_browser() as browser:
        viewer = run.viewer_pid
        page = open_page(browser, run.port, 600, 500)
        open_tab(page, "health")  # with the most changes
        debugger = page.context.new_cdp_session(page)
        debugger.send("Performance.enable")
        start = time.monotonic()

        def sample() -> Sample:
            return Sample(time.monotonic(), processor_time(viewer), len(run.statuses))

        before = sample()
        for number in range(SAMPLES + 1):
            due = start + 60.0 * (FIRST + number * (minutes - FIRST) / SAMPLES)
            page.wait_for_timeout(1e3 * max(0.0, due - time.monotonic()))
            now = sample()
            debugger.send("HeapProfiler.collectGarbage")
            heap, nodes = _page_memory(debugger)
            seconds = now.at - before.at
            rates = [one.rate for one in run.statuses[before.told :]]
            rows.append(
                row(
                    f"{(now.at - start) / 60:.1f}",
                    f"{memory(viewer):.1f}",
                    threads(viewer),
                    file_descriptors(viewer),
                    f"{100 * (now.viewer - before.viewer) / seconds:.1f} % of a core",
                    f"{heap:.1f}",
                    nodes,
                    f"{_renderers():.0f}",
                    f"{memory(run.control_pid):.1f}",
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


def _renderers() -> float:
    """Return the resident memory of the browser's renderer processes [MB]."""
    return sum(
        memory(pid) for pid in descendants(os.getpid()) if b"--type=renderer" in command(pid)
    )
