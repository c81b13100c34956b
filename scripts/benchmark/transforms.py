"""The transform library beside yourdfpy, pinocchio and tf2, in one run.

The contenders take turns, round after round, so that all of them see the machine in all its
moods; each figure is the median of the rounds.
"""

from __future__ import annotations

import io
import json
import platform
import random
import shutil
import statistics
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yourdfpy
from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped
from rclpy.time import Time
from sixty_links import sixty_links

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
SECOND = 1_000_000_000
START = 1_000 * SECOND
MOVED = (0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8)
PAN, TILT = "head_pan_joint", "head_tilt_joint"
BASE, CAMERA = "base_link", "camera_link"

Repeat = Callable[[int], float]
"""Does something so many times; gives the seconds that it took."""


@dataclass
class Row:
    """One line of the table.

    Attributes:
        work: what is done.
        contenders: who does it, ours first; a missing one is None.
        count: repetitions a round.
        wanted: the ratio asked for, and against whom.
        times: microseconds of each contender in each round.
    """

    work: str
    contenders: dict[str, Repeat | None]
    count: int
    wanted: str
    times: dict[str, list[float]] = field(default_factory=dict)

    def run(self) -> None:
        """One round."""
        for name, repeat in self.contenders.items():
            if repeat is not None:
                taken = repeat(self.count) / self.count * 1e6
                self.times.setdefault(name, []).append(taken)

    def text(self) -> str:
        """The line, medians and ratios."""
        medians = {name: statistics.median(times) for name, times in self.times.items()}
        ours, *others = self.contenders
        figures = [f"{medians[ours]:.2f}"]
        for other in others:
            if other in medians:
                ratio = statistics.median(
                    theirs / our
                    for theirs, our in zip(self.times[other], self.times[ours], strict=True)
                )
                figures.append(f"{other} {medians[other]:.2f}: **{ratio:.1f}x**")
        return f"| {self.work} | {figures[0]} | {'; '.join(figures[1:])} | {self.wanted} |"


def transforms() -> str:
    """The table of docs/benchmarks.md."""
    small = load_robot_model(robot_file("kinectbot"))
    large = sixty_links(small)
    workers = {name: Tf2(model) for name, model in (("15", small), ("60", large))}
    rows = [
        row
        for name, model in (("15", small), ("60", large))
        for row in rows_of(model, name, workers[name])
    ]
    for _ in range(ROUNDS):
        for row in rows:
            row.run()
    for worker in workers.values():
        worker.close()
    title = "| work (links) | ours, us | others, us, and how much slower they are | asked for |"
    note = f"| 10 s of history of 2 joints at 100 Hz | {memory(small):.0f} kB | | under 1 MB |"
    run_by = (
        f"Ours with Python {platform.python_version()}; tf2: {workers['15'].name or 'none here'}."
    )
    table = [title, "|---|---|---|---|", *(row.text() for row in rows), note, "", run_by]
    return "\n".join(table)


def rows_of(model: RobotModel, size: str, tf2: Tf2) -> list[Row]:
    """All comparisons on one robot."""
    chain = model.chain(BASE, CAMERA)
    rows = [
        Row(
            f"chain base to camera after a joint update, one frame ({size})",
            {
                "ours": timed(lambda: chain.transform(0.3, -0.2)),
                "pinocchio": pinocchio_chain(model),
                "yourdfpy": yourdfpy_chain(model),
            },
            400,
            "",
        )
    ]
    for feed, buffer, asked in (
        ("joints", fed_by_joints(model), ASKED_OF_JOINTS),
        ("/tf", fed_by_tf(model), ASKED_OF_TF),
    ):
        rows += [
            Row(f"{name}, {feed} ({size})", {"ours": work, "tf2": tf2.work(key)}, 400, asked[key])
            for key, (name, work) in lookups(buffer).items()
        ]
    return rows + writing(model, size, tf2)


ASKED_OF_JOINTS = {
    "ros_latest": "3x",
    "ros_past": "3x",
    "core_latest": "3x",
    "core_past": "3x",
    "can": "2x",
    "ros_point": "10x",
    "ros_pose": "4x",
}
ASKED_OF_TF = ASKED_OF_JOINTS | {"ros_past": "2x", "core_past": "2x", "ros_point": ""}


def lookups(buffer: Buffer) -> dict[str, tuple[str, Repeat]]:
    """What is asked of a buffer, by the name of the same work of tf2."""
    core, latest = buffer.core, Time()
    pasts = past_stamps()
    times = [Time(nanoseconds=stamp) for stamp in pasts]
    point, pose = PointStamped(), PoseStamped()
    point.header.frame_id = pose.header.frame_id = CAMERA
    point.point.x = pose.pose.orientation.w = 1.0
    return {
        "ros_latest": (
            "lookup latest, message out",
            timed(lambda: buffer.lookup_transform(BASE, CAMERA, latest)),
        ),
        "ros_past": (
            "lookup in the past, message out",
            cycling(lambda time: buffer.lookup_transform(BASE, CAMERA, time), times),
        ),
        "core_latest": ("latest, value", timed(lambda: core.lookup_transform(BASE, CAMERA))),
        "core_past": (
            "past, value",
            cycling(lambda stamp: core.lookup_transform(BASE, CAMERA, stamp), pasts),
        ),
        "can": ("can_transform", timed(lambda: buffer.can_transform(BASE, CAMERA, latest))),
        "ros_point": ("PointStamped", timed(lambda: buffer.transform(point, BASE))),
        "ros_pose": ("PoseStamped", timed(lambda: buffer.transform(pose, BASE))),
    }


def writing(model: RobotModel, size: str, tf2: Tf2) -> list[Row]:
    """What it costs to tell a buffer something."""
    all_joints = dict.fromkeys(model.independent_joints, 0.3)
    stamps = iter(range(START + 11 * SECOND, 2 * START, SECOND // 100))
    buffer, samples, changing = Buffer(), TransformBuffer(), fed_by_joints(model).core

    def sample(count: int) -> float:
        ahead = [next(stamps) for _ in range(count)]
        start = time.perf_counter()
        for stamp in ahead:
            samples.set_joint_positions(stamp, all_joints)
        return (time.perf_counter() - start) / len(all_joints)

    def put(count: int) -> float:
        messages = [message(next(stamps), BASE, CAMERA, MOVED) for _ in range(count)]
        start = time.perf_counter()
        for one in messages:
            buffer.set_transform(one, "benchmark")
        return time.perf_counter() - start

    def first(count: int) -> float:
        taken = 0.0
        for index in range(count // 20):
            place = Transform.from_xyz_rpy((float(next(stamps) + index), 0.0, 0.0))
            changing.set_transform(0, "world", BASE, place, static=True)
            start = time.perf_counter()
            changing.lookup_transform(BASE, CAMERA)
            taken += time.perf_counter() - start
        return taken * 20

    usual = timed(lambda: changing.lookup_transform(BASE, CAMERA))
    return [
        Row(f"set_transform ({size})", {"ours": put, "tf2": tf2.work("set")}, 400, "1x"),
        Row(
            f"a joint sample, {len(all_joints)} in a message ({size})",
            {"ours": sample, "tf2, one frame": tf2.work("set")},
            400,
            "",
        ),
        Row(
            f"a usual lookup ({size})",
            {"ours": usual, "the first one after a change on its way": first},
            400,
            "under 10x",
        ),
    ]


def fed_by_joints(model: RobotModel) -> Buffer:
    """A buffer with 10 s of a nodding head, 100 samples a second."""
    buffer = Buffer()
    buffer.core.set_model(model)
    for index in range(1001):
        buffer.core.set_joint_positions(*nodding(index))
    return buffer


def fed_by_tf(model: RobotModel) -> Buffer:
    """The same as transforms, as tf2 gets them."""
    buffer, told = Buffer(), frames(model)
    for parent, child, numbers in told["static"]:
        buffer.set_transform_static(message(0, parent, child, numbers))
    for seconds, parent, child, numbers in told["sampled"]:
        buffer.set_transform(message(round(seconds * SECOND), parent, child, numbers))
    return buffer


def message(stamp: int, parent: str, child: str, numbers: Sequence[float]) -> TransformStamped:
    """A transform of seven numbers."""
    x, y, z, *turn = numbers
    found = StampedTransform(stamp, parent, child, Transform((x, y, z), Rotation(*turn)))
    return transform_stamped(found)


def nodding(index: int) -> tuple[int, dict[str, float]]:
    """One of the samples: stamp [ns] and positions [rad]."""
    return START + index * SECOND // 100, {PAN: 0.001 * index, TILT: 0.5 - 0.001 * index}


def past_stamps() -> list[int]:
    """Times between samples, all over the history [ns]."""
    rnd = random.Random(1)
    return [START + rnd.randrange(10 * SECOND) for _ in range(512)]


def timed(work: Callable[[], object]) -> Repeat:
    """Repeats a call."""

    def repeat(count: int) -> float:
        start = time.perf_counter()
        for _ in range(count):
            work()
        return time.perf_counter() - start

    return repeat


def cycling(work: Callable[[Any], object], arguments: Sequence[Any]) -> Repeat:
    """Repeats a call with one argument after the other."""

    def repeat(count: int) -> float:
        start = time.perf_counter()
        for index in range(count):
            work(arguments[index % 512])
        return time.perf_counter() - start

    return repeat


def yourdfpy_chain(model: RobotModel) -> Repeat:
    """Yourdfpy's own scene graph, after an update of two joints."""
    robot = yourdfpy.URDF.load(io.BytesIO(model.urdf.encode()), load_meshes=False)
    configuration = {PAN: 0.3, TILT: -0.2}

    def work() -> None:
        robot.update_cfg(configuration)
        robot.get_transform(CAMERA, BASE)

    repeat = timed(work)
    return lambda count: repeat(max(1, count // 40)) * 40


def pinocchio_chain(model: RobotModel) -> Repeat | None:
    """Pinocchio's forward kinematics and one frame, after an update of two joints."""
    try:
        import pinocchio
    except ImportError:
        return None
    pin_model = pinocchio.buildModelFromXML(model.urdf)
    data, frame = pin_model.createData(), pin_model.getFrameId(CAMERA)
    configuration = pinocchio.neutral(pin_model)
    pan, tilt = (pin_model.joints[pin_model.getJointId(name)].idx_q for name in (PAN, TILT))

    def work() -> None:
        configuration[pan] = 0.3
        configuration[tilt] = -0.2
        pinocchio.forwardKinematics(pin_model, data, configuration)
        pinocchio.updateFramePlacement(pin_model, data, frame)

    return timed(work)


class Tf2:
    """tf2 in a process of its own, fed with what the buffer computes itself."""

    def __init__(self, model: RobotModel) -> None:
        self._process: subprocess.Popen[str] | None = None
        self.name = ""
        python = next(
            filter(has_tf2, (sys.executable, shutil.which("python3", path="/usr/bin"))), None
        )
        if python is None:
            return
        self._process = subprocess.Popen(
            [python, str(Path(__file__).with_name("tf2_worker.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=None if python == sys.executable else {},
        )
        self.name = self._ask(json.dumps(frames(model)))

    def work(self, name: str) -> Repeat | None:
        """One thing that tf2 does."""
        if self._process is None:
            return None
        return lambda count: float(self._ask(f"{name} {count}"))

    def close(self) -> None:
        """Ends the process."""
        if self._process is not None:
            self._process.communicate()

    def _ask(self, line: str) -> str:
        assert self._process is not None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._process.stdout.readline().strip()


def has_tf2(python: str | None) -> bool:
    """Whether this interpreter can import tf2_ros."""
    if python is None:
        return False
    environment = None if python == sys.executable else {}
    command = [python, "-c", "import tf2_ros, geometry_msgs.msg"]
    return (
        subprocess.run(command, check=False, capture_output=True, env=environment).returncode == 0
    )


def frames(model: RobotModel) -> dict[str, Any]:
    """The same robot and motion as transforms, for tf2."""
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


def memory(model: RobotModel) -> float:
    """What 10 s of two joints at 100 Hz take [kB]."""
    buffer = Buffer()
    buffer.core.set_model(model)
    rng = np.random.default_rng(1)
    numbers = rng.uniform(-1, 1, (1001, 2)).tolist()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for index, (pan, tilt) in enumerate(numbers):
        stamp = START + index * SECOND // 100
        buffer.core.set_joint_positions(stamp, {PAN: pan + 0.0, TILT: tilt + 0.0})
    used = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    return used / 1000
