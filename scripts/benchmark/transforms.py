"""The transform buffer beside tf2, in alternating rounds; each figure is a median."""

import json
import platform
import random
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from frame import medians, row, table
from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped
from rclpy.time import Time

from head_tracking.share import robot_file
from head_tracking.tf import Buffer
from head_tracking.tf.messages import transform_stamped
from head_tracking.transforms import (
    RobotModel,
    Rotation,
    StampedTransform,
    Transform,
    TransformBuffer,
    load_robot_model,
)

ROUNDS = 61
COUNT = 400  # repetitions in a round
SECOND = 1_000_000_000
START = 1_000 * SECOND
PAN, TILT = "head_pan_joint", "head_tilt_joint"
BASE, CAMERA = "base_link", "camera_link"
LOOKUPS = {
    # key of the worker of tf2 -> work, asked ratio with joint states, with /tf
    "ros_latest": ("lookup latest, message out", "3x", "3x"),
    "ros_past": ("lookup in the past, message out", "3x", "2x"),
    "core_latest": ("latest, value", "3x", "3x"),
    "core_past": ("past, value", "3x", "2x"),
    "can": ("can_transform", "2x", "2x"),
    "ros_point": ("PointStamped", "10x", ""),
    "ros_pose": ("PoseStamped", "4x", "4x"),
}

Repeat = Callable[[int], float]
"""Repeats a work so many times; returns the duration [s]."""


def transforms() -> str:
    """Return the table."""
    model = load_robot_model(robot_file("kinectbot"))
    tf2 = Tf2(model)
    works: dict[str, tuple[Repeat, Repeat | None, str]] = {}
    for feed, buffer, column in (("joints", fed_by_joints(model), 1), ("/tf", fed_by_tf(model), 2)):
        for key, repeat in lookups(buffer).items():
            works[f"{LOOKUPS[key][0]}, {feed}"] = repeat, tf2.work(key), LOOKUPS[key][column]
    usual, first = lookups_after_changes(fed_by_joints(model).core)
    works |= {
        "set_transform": (set_transforms(), tf2.work("set"), "1x"),
        "a sample of two joints; tf2: one frame": (joint_samples(model), tf2.work("set"), ""),
        "a usual lookup; other: the first one after a change on its route": (
            usual,
            first,
            "under 10x",
        ),
    }
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in works}
    for _ in range(ROUNDS):
        for name, (ours, other, _) in works.items():
            times[name].append((ours(COUNT), other(COUNT) if other else float("nan")))
    tf2.close()
    rows = []
    for name, rounds in times.items():
        microseconds = [1e6 / COUNT * seconds for seconds in medians(rounds)]
        ratio = statistics.median(other / ours for ours, other in rounds)
        cells = [f"{each:.2f}" for each in microseconds] + [f"**{ratio:.1f}x**"]
        rows.append(row(name, *cells, works[name][2]).replace("nan", "-"))
    return (
        table("work | ours, us | tf2, us | ratio | limit", rows)
        + f"\n\nOurs with Python {platform.python_version()}; tf2: {tf2.name or 'not installed'}."
    )


def lookups(buffer: Buffer) -> dict[str, Repeat]:
    """Return the works of a buffer by the key of the same work of tf2."""
    core, latest = buffer.core, Time()
    pasts = past_stamps()
    stamps, times = cycle(pasts), cycle([Time(nanoseconds=stamp) for stamp in pasts])
    point, pose = PointStamped(), PoseStamped()
    point.header.frame_id = pose.header.frame_id = CAMERA
    point.point.x = pose.pose.orientation.w = 1.0
    return {
        "ros_latest": timed(lambda: buffer.lookup_transform(BASE, CAMERA, latest)),
        "ros_past": timed(lambda: buffer.lookup_transform(BASE, CAMERA, next(times))),
        "core_latest": timed(lambda: core.lookup_transform(BASE, CAMERA)),
        "core_past": timed(lambda: core.lookup_transform(BASE, CAMERA, next(stamps))),
        "can": timed(lambda: buffer.can_transform(BASE, CAMERA, latest)),
        "ros_point": timed(lambda: buffer.transform(point, BASE)),
        "ros_pose": timed(lambda: buffer.transform(pose, BASE)),
    }


def lookups_after_changes(buffer: TransformBuffer) -> tuple[Repeat, Repeat]:
    """Return a usual lookup, and the first lookup after a change on its route."""
    heights = iter(range(1, 1_000_000_000))

    def first(count: int) -> float:
        duration = 0.0
        for _ in range(count // 20):
            moved = Transform.from_xyz_rpy((float(next(heights)), 0.0, 0.0))
            buffer.set_transform(0, "world", BASE, moved, static=True)
            start = time.perf_counter()
            buffer.lookup_transform(BASE, CAMERA)
            duration += time.perf_counter() - start
        return duration * 20

    return timed(lambda: buffer.lookup_transform(BASE, CAMERA)), first


def set_transforms() -> Repeat:
    """Return the work of `Buffer.set_transform` with new stamps."""
    buffer, stamps = Buffer(), new_stamps()
    moved = (0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8)

    def repeat(count: int) -> float:
        messages = iter([message(next(stamps), BASE, CAMERA, moved) for _ in range(count)])
        return timed(lambda: buffer.set_transform(next(messages), "benchmark"))(count)

    return repeat


def joint_samples(model: RobotModel) -> Repeat:
    """Return the work of `TransformBuffer.set_joint_positions`."""
    buffer, stamps = TransformBuffer(), new_stamps()
    joints = dict.fromkeys(model.independent_joints, 0.3)
    return timed(lambda: buffer.set_joint_positions(next(stamps), joints))


def new_stamps() -> Iterator[int]:
    """Return stamps after those of the buffers, 100 a second [ns]."""
    return iter(range(START + 11 * SECOND, 2 * START, SECOND // 100))


def fed_by_joints(model: RobotModel) -> Buffer:
    """Return a buffer with 10 s of a nodding head, 100 samples a second."""
    buffer = Buffer()
    buffer.core.set_model(model)
    for index in range(1001):
        buffer.core.set_joint_positions(*nodding(index))
    return buffer


def fed_by_tf(model: RobotModel) -> Buffer:
    """Return the same as transforms, as tf2 receives them."""
    buffer, found = Buffer(), frames(model)
    for parent, child, numbers in found["static"]:
        buffer.set_transform_static(message(0, parent, child, numbers))
    for seconds, parent, child, numbers in found["sampled"]:
        buffer.set_transform(message(round(seconds * SECOND), parent, child, numbers))
    return buffer


def message(stamp: int, parent: str, child: str, numbers: Sequence[float]) -> TransformStamped:
    """Return a message from position [m] and quaternion xyzw."""
    x, y, z, *quaternion = numbers
    transform = Transform((x, y, z), Rotation(*quaternion))
    return transform_stamped(StampedTransform(stamp, parent, child, transform))


def nodding(index: int) -> tuple[int, dict[str, float]]:
    """Return stamp [ns] and positions [rad] of a sample."""
    return START + index * SECOND // 100, {PAN: 0.001 * index, TILT: 0.5 - 0.001 * index}


def past_stamps() -> list[int]:
    """Return times between samples over the whole history [ns]."""
    rnd = random.Random(1)
    return [START + rnd.randrange(10 * SECOND) for _ in range(512)]


def timed(work: Callable[[], object]) -> Repeat:
    """Return a function that repeats a call."""

    def repeat(count: int) -> float:
        start = time.perf_counter()
        for _ in range(count):
            work()
        return time.perf_counter() - start

    return repeat


class Tf2:
    """tf2 in a process of its own, with the transforms that the buffer computes itself."""

    def __init__(self, model: RobotModel) -> None:
        self._process: subprocess.Popen[str] | None = None
        self.name = ""
        for python in (sys.executable, shutil.which("python3", path="/usr/bin")):
            environment = None if python == sys.executable else {}
            test = [str(python), "-c", "import tf2_ros, geometry_msgs.msg"]
            if not python:
                continue
            tried = subprocess.run(test, check=False, capture_output=True, env=environment)
            if tried.returncode == 0:
                self._process = subprocess.Popen(
                    [python, str(Path(__file__).with_name("tf2_worker.py"))],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                    env=environment,
                )
                self.name = self._ask(json.dumps(frames(model)))
                return

    def work(self, name: str) -> Repeat | None:
        """Return a work of tf2; None without tf2."""
        return (lambda count: float(self._ask(f"{name} {count}"))) if self._process else None

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.communicate()

    def _ask(self, line: str) -> str:
        assert self._process and self._process.stdin and self._process.stdout
        print(line, file=self._process.stdin, flush=True)
        return self._process.stdout.readline().strip()


def frames(model: RobotModel) -> dict[str, Any]:
    """Return the robot and its motion as transforms, for tf2."""
    joints = model.joints.values()
    moving = [joint for joint in joints if joint.moves]
    still = dict.fromkeys((joint.name for joint in moving), 0.0)
    return {
        "static": [(j.parent, j.child, list(j.origin)) for j in joints if not j.moves],
        "sampled": [
            (stamp / SECOND, j.parent, j.child, list(j.transform((still | positions)[j.name])))
            for stamp, positions in map(nodding, range(1001))
            for j in moving
        ],
        "target": BASE,
        "source": CAMERA,
        "past": [stamp / SECOND for stamp in past_stamps()],
    }
