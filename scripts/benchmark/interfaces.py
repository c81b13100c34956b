"""PointHead's goals against the true angles, and preemption over DDS."""

from __future__ import annotations

import math
import random
import statistics
import time
from collections import Counter
from contextlib import closing
from itertools import pairwise
from typing import Any

import rclpy
from frame import row, table
from rclpy.signals import SignalHandlerOptions
from robot_under_test import Robot

from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model

GOALS = 500  # of each robot
PREEMPTIONS = 50


def interfaces() -> str:
    """The tables of docs/benchmarks.md."""
    return f"{point_head()}\n\n{preemption()}"


def point_head() -> str:
    """Random goals in simulated time; whether each end is true."""
    from goals import PointedHead, random_point  # (they need control_msgs)

    rows = []
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    rclpy.logging.set_logger_level("point_head", rclpy.logging.LoggingSeverity.FATAL)
    try:
        for robot in ("kinectbot", "turtlebot"):
            pointed = PointedHead(load_robot_model(robot_file(robot)))
            rnd, ends, untrue = random.Random(1), Counter[str](), 0
            off, misses, times = [], [], []
            for _ in range(GOALS):
                point, before = random_point(rnd), pointed.true
                begun = pointed.world.seconds
                goal = pointed.look_at(point)
                times.append(pointed.world.seconds - begun)
                pointed.world.run(0.02)
                ends[goal.status] += 1
                reached = pointed.head.gaze(point, *before).reached
                untrue += reached is not (goal.status == "succeeded")
                if goal.status == "succeeded":
                    miss = math.degrees(pointed.true_miss(point))
                    off.append(abs(float(pointed.said.split()[-2]) - miss))
                    misses.append(miss)
            pointed.node.destroy_node()
            rows.append(
                row(
                    f"{robot}, {GOALS}",
                    ends["succeeded"],
                    ends["aborted"],
                    untrue,
                    f"{max(off):.2f}°",
                    f"{max(misses):.2f}°",
                    f"{statistics.mean(misses):.2f}°",
                    f"{statistics.median(times):.2f} s",
                )
            )
    finally:
        rclpy.shutdown()
    return table(
        "PointHead, random goals | succeeded | aborted: out of reach | ends that are not true | "
        "reported less true miss, worst | true miss, worst | mean | time a goal, median", rows
    )  # fmt: skip


def preemption() -> str:
    """Over DDS, by the wall clock."""
    ended, moved, rates = _preemption_over_dds()
    rows = [
        _row("newer goal sent until the older one's client has heard its end, over DDS", ended),
        _row("newer goal sent until the servos are told something else, over DDS", moved),
        row("feedback a second, over DDS", f"{statistics.median(rates):.0f}", f"{min(rates):.0f}"),
    ]
    return table(f"PointHead, {PREEMPTIONS} preemptions | median | worst", rows)


def _preemption_over_dds() -> tuple[list[float], list[float], list[float]]:
    from action_client import Client
    from goals import PointHead, point_goal

    ended, moved, rates = [], [], []
    with closing(Robot(["--sim", "--mode", "point"], [])) as robot:
        client = Client(robot.node, PointHead, "point_head/point_head_action")
        backend, written = robot.composition.loop.backend, []
        write = backend.write

        def record(sender: str, goals: Any, epoch: int) -> None:
            write(sender, goals, epoch)
            written.append((time.monotonic(), goals["head_pan_joint"].position))

        backend.write = record
        side = 1.0
        older = client.send(point_goal(1.0, 2.0 * side, 0.3, velocity=1.0))
        for _ in range(PREEMPTIONS):
            time.sleep(0.6)
            del written[:-1]
            side, sent = -side, time.monotonic()
            newer = client.send(point_goal(1.0, 2.0 * side, 0.3, velocity=1.0))
            assert newer.accepted
            ended.append(older.ended_at - sent)
            time.sleep(0.4)
            turned = _turned(written, -side)
            if turned is not None and turned > sent:  # else it had arrived, or stood still
                moved.append(turned - sent)
            times = [at for at, _ in older.feedback]
            if len(times) > 2:
                rates.append((len(times) - 1) / (times[-1] - times[0]))
            older = newer
    return ended, moved, rates


def _turned(written: list[tuple[float, float]], before: float) -> float | None:
    """When the goals written first went on to the side of before by less than half of 1 rad/s."""
    for (_, old), (at, new) in pairwise(written):
        if (new - old) * before < 0.01:
            return at
    return None


def _row(what: str, times: list[float]) -> str:
    return row(what, f"{1e3 * statistics.median(times):.0f} ms", f"{1e3 * max(times):.0f} ms")
