"""By how much the tutorials' formula misses, and what exact pointing costs."""

from __future__ import annotations

import math
import random
import time

from frame import row, table

from head_tracking.gaze import PanTiltHead
from head_tracking.share import robot_file
from head_tracking.transforms import RobotModel, load_robot_model, parse_robot_model

PAN, TILT = "head_pan_joint", "head_tilt_joint"


def pointing() -> str:
    """By how much the tutorials' formula misses, and what exact pointing costs."""
    rows = []
    for robot in ("kinectbot", "turtlebot"):
        model = load_robot_model(robot_file(robot))
        head = PanTiltHead(model, PAN, TILT, "camera_link")
        for distance in (0.4, 0.6, 1.0, 2.0):
            rnd = random.Random(1)
            targets = [
                _around(model, distance, rnd.uniform(-1.2, 1.2), rnd.uniform(-0.5, 0.8))
                for _ in range(500)
            ]
            start = time.perf_counter()
            gazes = [head.gaze(target, 0.0, 0.0) for target in targets]
            cost = (time.perf_counter() - start) / len(targets)
            exact = max(
                head.miss(target, gaze.pan, gaze.tilt)
                for target, gaze in zip(targets, gazes, strict=True)
                if gaze.reached
            )
            tutorial = [head.miss(target, *_tutorial(model, target)) for target in targets]
            rows.append(
                row(
                    robot,
                    f"{distance} m",
                    f"{math.degrees(max(tutorial)):.1f}",
                    f"{math.degrees(sum(tutorial) / len(tutorial)):.1f}",
                    f"{math.degrees(exact):.0e}",
                    f"{cost * 1e6:.0f}",
                )
            )
    head = "robot | distance | tutorials, worst | tutorials, mean | exact, worst | us a gaze"
    return f"{table(head, rows)}\n\n{_askew()}"


NEARLY_SQUARE = {
    "square": ("1.5707963267948966 0 0", "-1.5707963267948966 0 0"),
    "1.5708 for a right angle": ("1.5708 0 0", "-1.5708 0 0"),
    "1.57 for a right angle": ("1.57 0 0", "-1.57 0 0"),
    "camera and tilt axis 0.1 degrees askew": (
        "1.5707963267948966 0.00174 0.00174",
        "-1.5707963267948966 0.00174 0.00174",
    ),
    "camera and tilt axis 11 degrees askew": ("1.37 0.2 0.1", "-1.4 0.2 0.2"),
}


def _askew() -> str:
    """What a gaze costs on heads that are not quite square, in rounds side by side."""
    heads, targets, costs = {}, {}, {}
    for name, (tilt_rpy, camera_rpy) in NEARLY_SQUARE.items():
        model = parse_robot_model(
            '<robot name="head"><link name="base"/><link name="pan"/><link name="tilt"/>'
            f'<link name="camera"/><joint name="{PAN}" type="revolute"><parent link="base"/>'
            '<child link="pan"/><axis xyz="0 0 1"/><limit lower="-2.6" upper="2.6"/></joint>'
            f'<joint name="{TILT}" type="revolute"><parent link="pan"/><child link="tilt"/>'
            f'<origin xyz="0.03 -0.02 0.05" rpy="{tilt_rpy}"/><axis xyz="0 0 -1"/>'
            '<limit lower="-2" upper="2"/></joint>'
            '<joint name="mount" type="fixed"><parent link="tilt"/><child link="camera"/>'
            f'<origin xyz="0.05 0.03 0.06" rpy="{camera_rpy}"/></joint></robot>'
        )
        heads[name] = PanTiltHead(model, PAN, TILT, "camera")
        rnd = random.Random(1)
        targets[name] = [
            model.transform(
                "base", "camera", {PAN: rnd.uniform(-1.2, 1.2), TILT: rnd.uniform(-0.9, 0.9)}
            )
            @ (rnd.uniform(0.4, 4.0), 0.0, 0.0)
            for _ in range(300)
        ]
        costs[name] = math.inf
    worst = {}
    for _ in range(20):
        for name, head in heads.items():
            start = time.perf_counter()
            gazes = [head.gaze(target, 0.0, 0.0) for target in targets[name]]
            costs[name] = min(costs[name], (time.perf_counter() - start) / len(gazes))
            worst[name] = max(gaze.miss for gaze in gazes)
    rows = [
        row(
            name,
            f"{costs[name] * 1e6:.1f}",
            f"{costs[name] / costs['square']:.2f}",
            f"{math.degrees(worst[name]):.0e}",
        )
        for name in heads
    ]
    return table("head | us a gaze | of a square head's | worst miss, degrees", rows)


def _around(model: RobotModel, distance: float, azimuth: float, elevation: float) -> list[float]:
    """A point at a distance from the pan axis at the height of the tilt axis [m, base frame]."""
    origin = model.transform("head_pan_link", "head_tilt_link", {PAN: 0.0}).translation
    flat = distance * math.cos(elevation)
    return [
        origin[0] + flat * math.cos(azimuth),
        origin[1] + flat * math.sin(azimuth),
        origin[2] + distance * math.sin(elevation),
    ]


def _tutorial(model: RobotModel, target: list[float]) -> tuple[float, float]:
    """The tutorials' angles, from rest and with the sign that the model needs."""
    x, y, _ = target
    pan = math.atan2(y, x)
    T_tilt_pan = model.transform("head_tilt_link", "head_pan_link", {PAN: 0.0})
    x, y, z = T_tilt_pan @ target
    return pan, -math.atan2(z, math.hypot(x, y))
