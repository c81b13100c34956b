"""Gaze, tracking and bus of every robot of the package, in simulated time."""

from __future__ import annotations

import math
from statistics import median

import numpy as np
from frame import table
from robot_pursuit import PERIOD, Pursuit

from head_tracking.share import robot_names

_GAZES = 500
_SECONDS = 20.0


def robots() -> str:
    """Return a row for each robot."""
    rows = []
    for name in robot_names():
        pursuit = Pursuit(name, 0.5).run(_SECONDS)
        models = {servo.model.name for servo in pursuit.servos}
        rows.append(
            f"| {name} | {', '.join(sorted(models))} | {_worst_gaze(pursuit):.1e} "
            f"| {math.degrees(pursuit.rms):.2f} | {math.degrees(max(pursuit.errors)):.2f} "
            f"| {1e6 * median(pursuit.step_times):.0f} | {1e3 * median(pursuit.cycles):.2f} |"
        )
    return (
        table(
            "robot | servos | worst of 500 gazes, rad | tracking at 0.5 Hz: rms, "
            "degrees | largest | step, us | cycle, ms",
            rows,
        )
        + f"\n\nA target 2.5 m away swings by 0.4 rad for {_SECONDS:.0f} s of simulated time, from "
        f"rest; its points are 30 ms old, the cycle is {1e3 * PERIOD:.0f} ms, all of it counts. "
        "Step: processor time of the tracker, median; cycle: simulated time on the wire, median. "
        "Nothing was measured on hardware."
    )


def _worst_gaze(pursuit: Pursuit) -> float:
    """Return the largest miss of exact gazes at random points within the limits [rad]."""
    rng = np.random.default_rng(1)
    head, worst = pursuit.head, 0.0
    limits = [(servo.lower, servo.upper) for servo in pursuit.servos]
    for _ in range(_GAZES):
        pan, tilt = (0.98 * rng.uniform(low, high) for low, high in limits)
        point = pursuit.point_seen(rng.uniform(0.5, 5.0), pan, tilt)
        gaze = head.gaze(point, pan, tilt)
        worst = max(worst, head.miss(point, gaze.pan, gaze.tilt))
    return worst
