"""By how much the tutorials' formula misses, and what exact pointing costs."""

import math
import random
import time

from frame import row, table

from head_tracking.gaze import PanTiltHead
from head_tracking.share import robot_file
from head_tracking.transforms import RobotModel, load_robot_model

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
    return table(head, rows)


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
