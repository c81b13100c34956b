"""Head, camera and page on machines of their own: network namespaces, joined by a switch of ours.

The switch hands Ethernet frames on with delay, jitter and loss, as netem would, which not every
kernel has. It needs root, for the namespaces and their interfaces.
"""

from __future__ import annotations

import fcntl
import heapq
import json
import math
import multiprocessing
import os
import random
import re
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from statistics import median
from typing import Any

from frame import row, table

HOSTS = ("head", "camera", "page")
DOMAIN = "35"
_TUNSETIFF, _TAP = 0x400454CA, 0x1002  # a TAP device, without a header of its own
_SWING = 14.0  # s
_STEPS = 12
_STEP = 1.6  # s


@dataclass(frozen=True)
class Link:
    """What every frame meets on its way from one machine to another."""

    name: str
    loss: float = 0.0
    delay: float = 0.0  # s
    jitter: float = 0.0  # s, either way
    server: bool = False  # discovery by a server instead of multicast


LINKS = (
    Link("good"),
    Link("good, discovery server", server=True),
    Link("5 % loss", loss=0.05),
    Link("20 ms", delay=0.02),
    Link("20 ± 15 ms, 2 % loss", loss=0.02, delay=0.02, jitter=0.015),
    Link("20 ± 15 ms, 2 % loss, server", 0.02, 0.02, 0.015, server=True),
)


def _tap(name: str) -> int:
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH22s", name.encode(), _TAP, b""))
    return device


def _switch(devices: Sequence[int], link: Link, cut: Synchronized[int]) -> None:
    """Hands frames on until the process is ended; `cut` is the host that nobody reaches, or -1."""
    draw = random.Random(1)
    waiting: list[tuple[float, int, int, bytes]] = []
    number = 0
    while True:
        rest = waiting[0][0] - time.monotonic() if waiting else 1.0
        for source in select.select(devices, (), (), max(0.0, rest))[0]:
            frame = os.read(source, 65536)
            origin = devices.index(source)
            for target, device in enumerate(devices):
                lost = draw.random() < link.loss or cut.value in (origin, target)
                if target == origin or lost:
                    continue
                due = time.monotonic() + link.delay + draw.uniform(-1.0, 1.0) * link.jitter
                number += 1
                heapq.heappush(waiting, (due, number, device, frame))
        while waiting and waiting[0][0] <= time.monotonic():
            _, _, device, frame = heapq.heappop(waiting)
            with suppress(OSError):  # the machine is down
                os.write(device, frame)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


@contextmanager
def machines(link: Link) -> Iterator[Synchronized[int]]:
    """Three namespaces with an address each, 10.77.0.1 to 3; gives the switch's knife."""
    cut: Synchronized[int] = multiprocessing.Value("i", -1)
    with ExitStack() as stack:
        devices = []
        for number, host in enumerate(HOSTS, 1):
            space, tap = f"ht_{host}", f"ht{os.getpid() % 10000}_{number}"
            _ip("netns", "add", space)
            stack.callback(_ip, "netns", "del", space)
            devices.append(_tap(tap))
            stack.callback(os.close, devices[-1])
            _ip("link", "set", tap, "netns", space)
            _ip("-n", space, "addr", "add", f"10.77.0.{number}/24", "dev", tap)
            _ip("-n", space, "link", "set", "lo", "up")
            _ip("-n", space, "link", "set", tap, "up")
            _ip("-n", space, "route", "add", "default", "dev", tap)
        process = multiprocessing.Process(target=_switch, args=(devices, link, cut), daemon=True)
        process.start()
        stack.callback(process.join, 5.0)
        stack.callback(process.terminate)
        yield cut


def _start(host: str, link: Link, *command: object, **options: Any) -> subprocess.Popen[str]:
    environment = os.environ | {
        "ROS_DOMAIN_ID": DOMAIN,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",  # namespaces share memory, machines do not
    }
    if link.server:
        environment["ROS_DISCOVERY_SERVER"] = "10.77.0.1:11811"
    words = ["ip", "netns", "exec", f"ht_{host}", *map(str, command)]
    # A session of its own, so that what it starts in turn is ended with it.
    return subprocess.Popen(words, env=environment, text=True, start_new_session=True, **options)


def _end(process: subprocess.Popen[str]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGTERM)
    process.wait(15.0)


def _role(name: str, *arguments: object) -> tuple[object, ...]:
    return (sys.executable, __file__, name, *arguments)


def measured(link: Link, cut_for: float = 0.0) -> dict[str, Any]:
    """Runs head, camera and page over a link; what camera and page have seen."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        cut = stack.enter_context(machines(link))
        place = Path(folder)
        log = stack.enter_context((place / "head.log").open("w"))

        def start(host: str, *command: object, **options: Any) -> subprocess.Popen[str]:
            process = _start(host, link, *command, **options)
            stack.callback(_end, process)
            return process

        if link.server:
            start("head", sys.executable, Path(sys.prefix, "tools/fastdds/fastdds.py"),
                  "discovery", "-i", 0, "-l", "10.77.0.1", "-p", 11811, stdout=log)  # fmt: skip
            time.sleep(1.0)
        start("head", Path(sys.prefix, "bin", "head_tracking"), "--sim", "--network",
              "--target", "none", stdout=log, stderr=log)  # fmt: skip
        page = start("page", *_role("page", place / "page.json"))
        camera = start("camera", *_role("camera", place / "camera.json", cut_for))
        if cut_for:
            _wait_for(place / "swinging")
            time.sleep(5.0)
            cut.value = HOSTS.index("camera")
            time.sleep(cut_for)
            cut.value = -1
        else:
            _wait_for(place / "swinging")
            report = _start("page", link, sys.executable, "-m", "head_tracking.cli.track_report",
                            "--duration", _SWING - 5.0, "--output", place / "report.svg",
                            "--markdown",
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip
            said, _ = report.communicate(timeout=90.0)
        camera.wait(120.0)
        page.terminate()
        page.wait(10.0)
        seen = json.loads((place / "camera.json").read_text())
        seen["page"] = json.loads((place / "page.json").read_text())
        seen["report"] = "" if cut_for else said
        seen["head"] = (place / "head.log").read_text()
        return seen


def _wait_for(file: Path) -> None:
    deadline = time.monotonic() + 60.0
    while not file.exists():
        if time.monotonic() > deadline:
            raise TimeoutError(f"no {file.name}: camera and head have not found each other")
        time.sleep(0.05)


def camera(file: Path, cut_for: float) -> None:
    """Publishes a target that swings, then one that makes small steps; writes down what came."""
    import rclpy
    from geometry_msgs.msg import PointStamped
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import JointState

    rclpy.init()
    node = rclpy.create_node("camera")
    publisher = node.create_publisher(PointStamped, "target_point", 10)
    goals: list[tuple[int, float]] = []
    states: list[tuple[int, int]] = []

    def stamp(message: Any) -> int:
        return int(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)

    def on_goals(message: Any) -> None:
        if "head_pan_joint" in message.name:
            at = message.name.index("head_pan_joint")
            goals.append((stamp(message), message.position[at]))

    node.create_subscription(JointState, "joint_goals", on_goals, 50)
    node.create_subscription(
        JointState, "servo_states", lambda m: states.append((time.time_ns(), stamp(m))), 50
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    began = time.monotonic()

    def send(y: float) -> int:
        now = time.time_ns()
        message = PointStamped()
        message.header.frame_id = "torso_link"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        message.point.x, message.point.y, message.point.z = 1.0, y, 0.4
        publisher.publish(message)
        return now

    def spin_until(when: float) -> None:
        while (rest := when - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=rest)

    def swing(seconds: float) -> None:
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            send(0.4 * math.sin(2.0 * math.pi * 0.3 * now))
            spin_until(now + 0.02)

    while not goals:  # the head looks for others first
        send(0.0)
        spin_until(time.monotonic() + 0.02)
    met = time.monotonic() - began
    (file.parent / "swinging").touch()
    swing(_SWING + cut_for)
    steps = []
    if not cut_for:
        for number in range(_STEPS + 1):
            y, begin = (0.04 if number % 2 else -0.04), 0
            end = time.monotonic() + _STEP + 0.02 * random.random()
            while (now := time.monotonic()) < end:
                sent = send(y)
                begin = begin or sent
                spin_until(now + 0.02)
            if number:
                steps.append(begin)
    file.write_text(json.dumps({"met": met, "goals": goals, "states": states, "steps": steps}))
    node.destroy_node()
    rclpy.try_shutdown()


def page(file: Path) -> None:
    """Listens, and writes down what the head says of itself until it is ended."""
    import rclpy
    from geometry_msgs.msg import PointStamped
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions
    from std_msgs.msg import String

    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(1))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("page")
    said: list[tuple[float, str]] = []
    targets: list[float] = []
    node.create_subscription(
        String, "head_tracker/state", lambda m: said.append((time.time(), m.data)), 10
    )
    node.create_subscription(
        PointStamped, "target_point", lambda _: targets.append(time.time()), 50
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not ended:
        executor.spin_once(timeout_sec=0.1)
    file.write_text(json.dumps({"said": said, "targets": targets}))
    node.destroy_node()
    rclpy.try_shutdown()


def latencies(seen: dict[str, Any]) -> list[float]:
    """From a step of the target to the first packet that goes there, s; by the head's clock."""
    found = []
    for step in seen["steps"]:
        before = [goal for at, goal in seen["goals"] if at <= step]
        after = [at for at, goal in seen["goals"] if at > step and abs(goal - before[-1]) > 0.005]
        if before and after:
            found.append((after[0] - step) * 1e-9)
    return found


def _error(report: str) -> str:
    """The errors of a report by `track_report`."""
    rows = dict(re.findall(r"^\| (error, rms|error, max|target) \| (.*?) \|", report, re.MULTILINE))
    if len(rows) < 3:
        return report.strip()[-200:] or "nothing"
    return f"{rows['error, rms']}, {rows['error, max']} at most; {rows['target']}"


def network() -> str:
    """The table: what each link costs."""
    rows = []
    for link in LINKS:
        seen = measured(link)
        late = latencies(seen)
        came = [at for at, _ in seen["states"]]
        ages = [(at - stamp) * 1e-9 for at, stamp in seen["states"]]
        rate = (len(came) - 1) / ((came[-1] - came[0]) * 1e-9)
        rows.append(
            row(
                link.name,
                f"{seen['met']:.1f} s",
                f"{1e3 * median(late):.0f}, {1e3 * max(late):.0f} ms "
                f"({len(late)} of {_STEPS} steps)",
                f"{rate:.1f} Hz, {1e3 * median(ages):.0f} ms",
                _error(seen["report"]),
            )
        )
    head = (
        "Link, each way | found each other after | target to packet, median and worst | joint "
        "states on the camera's machine: rate, age | tracking error, seen from the page"
    )
    cut = _told(measured(LINKS[0], cut_for=5.0)["page"])
    return f"{table(head, rows)}\n\nThe camera's cable out for 5 s, as the page sees it:\n\n{cut}"


def _told(page: dict[str, Any]) -> str:
    """What the head says of itself around the longest pause between two targets."""
    targets = page["targets"]
    gaps = [(later - earlier, earlier) for earlier, later in pairwise(targets)]
    gap, begin = max(gaps)
    moments = [(gap, "(the first target that comes again)")]
    last = ""
    for at, text in page["said"]:
        if begin - 0.5 <= at <= begin + gap + 3.0 and text != last:
            moments.append((at - begin, text))
            last = text
    rows = [row(f"{when:+.2f} s", text) for when, text in sorted(moments)]
    return table("Time after the last target | the head says", rows)


if __name__ == "__main__":
    if sys.argv[1] == "camera":
        camera(Path(sys.argv[2]), float(sys.argv[3]))
    elif sys.argv[1] == "page":
        page(Path(sys.argv[2]))
    else:
        print(network())
