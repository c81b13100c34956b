"""PointHead's goals against the true angles, preemption over DDS, heads that others drive."""

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
from closed_loop import ClosedLoop, Conditions, Path, ax12, kinectbot
from plant import Make, Streamed
from rclpy.signals import SignalHandlerOptions
from robot_under_test import Robot
from tracking import HEAD, PATHS

from head_tracking.share import robot_file
from head_tracking.tracking import LAWS, SetpointStream, Tracker
from head_tracking.transforms import load_robot_model

GOALS = 500  # of each robot
PREEMPTIONS = 50
SEEDS = range(1, 6)
FOLLOWED = (
    "still",
    "±0.5 rad, 0.2 Hz",
    "±0.5 rad, 0.5 Hz",
    "±0.5 rad, 1 Hz",
    "walks past at 1.5 m",
    "comes nearer",
    "circle",
    "wanders",
    "fictitious, tutorial 2",
)


def interfaces() -> str:
    """The tables of docs/results.md."""
    return "\n\n".join("\n".join(table) for table in (point_head(), preemption(), driven()))


def point_head() -> list[str]:
    """Random goals in simulated time; whether each end is true."""
    from goals import PointedHead, random_point  # (they need control_msgs)

    rows = [
        "| PointHead, random goals | succeeded | aborted: out of reach | ends that are not true | "
        "reported less true miss, worst | true miss, worst | mean | time a goal, median |",
        "|---|---|---|---|---|---|---|---|",
    ]
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
                f"| {robot}, {GOALS} | {ends['succeeded']} | {ends['aborted']} | {untrue} | "
                f"{max(off):.2f}° | {max(misses):.2f}° | {statistics.mean(misses):.2f}° | "
                f"{statistics.median(times):.2f} s |"
            )
    finally:
        rclpy.shutdown()
    return rows


def preemption() -> list[str]:
    """In simulated time, where only the loop's cycle counts; and over DDS, by the wall clock."""
    simulated = _simulated_preemption()
    ended, moved, rates = _preemption_over_dds()
    return [
        f"| PointHead, {PREEMPTIONS} preemptions | median | worst |",
        "|---|---|---|",
        _row("newer goal taken until the servos are told something else, simulated", simulated),
        _row("newer goal sent until the older one's client has heard its end, over DDS", ended),
        _row("newer goal sent until the servos are told something else, over DDS", moved),
        f"| feedback a second, over DDS | {statistics.median(rates):.0f} | {min(rates):.0f} |",
    ]


def _simulated_preemption() -> list[float]:
    from goals import HeldGoal, PointedHead, point_goal

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        pointed, rnd, side, found = PointedHead(kinectbot()), random.Random(1), 1.0, []
        world, written = pointed.world, []
        write = world.write

        def record(sender: str, goals: Any, epoch: int) -> None:
            write(sender, goals, epoch)
            written.append((world.seconds, goals["head_pan_joint"].position))

        world.write = record
        goal = HeldGoal(point_goal(1.0, 2.0 * side, 0.3, velocity=1.0))
        pointed.node.actions.point(goal)
        for _ in range(PREEMPTIONS):
            world.run(0.6 + rnd.uniform(0.0, 0.02))
            del written[:-1]
            side, sent = -side, world.seconds
            newer = HeldGoal(point_goal(1.0, 2.0 * side, 0.3, velocity=1.0))
            pointed.node.actions.point(newer)
            assert goal.status == "aborted"
            world.run(0.2)
            turned = _turned(written, -side)
            assert turned is not None
            found.append(turned - sent)
            goal = newer
        pointed.node.destroy_node()
    finally:
        rclpy.shutdown()
    return found


def _preemption_over_dds() -> tuple[list[float], list[float], list[float]]:
    from action_client import Client
    from goals import PointHead, point_goal

    ended, moved, rates = [], [], []
    with closing(Robot(["--sim", "--mode", "point"], [])) as robot:
        client = Client(robot.node, PointHead, "point_head/point_head_action")
        loop, written = robot.composition.loop, []
        write = loop.write
        assert write is not None

        def record(sender: str, goals: Any, epoch: int) -> None:
            write(sender, goals, epoch)
            written.append((time.monotonic(), goals["head_pan_joint"].position))

        loop.write = record
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
    return f"| {what} | {1e3 * statistics.median(times):.0f} ms | {1e3 * max(times):.0f} ms |"


def driven() -> list[str]:
    """Tracking through a trajectory controller beside tracking by the servo bus."""
    late = Streamed(0.05, stream=lambda: SetpointStream(0.02, 0.0))
    rows = [
        "| Driven by a 100 Hz trajectory controller, 50 ms late | servo bus, mrad | controller |",
        "|---|---|---|",
    ]
    for name in FOLLOWED:
        rows.append(
            f"| {name} | {_error(PATHS[name], ax12()):.1f} | {_error(PATHS[name], late):.1f} |"
        )
    return rows


def _error(path: Path, servos: Make) -> float:
    """The median of some seeds [mrad rms]."""
    errors = []
    for seed in SEEDS:
        conditions = Conditions(duration=12.0, noise=0.002, seed=seed, servos=servos)
        outcome = ClosedLoop(path, conditions).run(Tracker(HEAD, LAWS["predictive"](HEAD, 0.02)))
        errors.append(1e3 * outcome.recording.between(3.0).rms)
    return statistics.median(errors)
