"""Pointing errors of random heads before and after calibration, and coverage of its intervals."""

from __future__ import annotations

import math
import time

import numpy as np
from frame import row, table
from random_head import CAMERA, SIZE, kinectbot_geometry, pointing_error, random_head

from head_tracking.calibration.geometry import PARAMETERS
from head_tracking.calibration.solver import CalibrationError, solve

HEADS = 200
_TARGETS = {0: "marker", 1: "face", 12: "12 points of a room"}


def calibration() -> str:
    """Return the table."""
    rows = [
        _row(*case)
        for case in ((0.5, 0.0, 0), (2.0, 0.0, 0), (0.5, 1.0, 0), (1.0, 0.0, 1), (1.0, 0.0, 12))
    ]
    return table(
        "target, its noise, play behind the encoders | pointing error on held-out views before: "
        "median, worst | after: median, worst; rms | intervals of 95 % with the truth inside; "
        "refused | play found: error, median, worst | time to compute",
        rows,
    )


def _row(noise: float, play: float, points: int) -> str:
    geometry = kinectbot_geometry()
    before, after, times, plays = [], [], [], []
    inside: list[bool] = []
    refused = 0
    for seed in range(1000, 1000 + HEADS):
        head = random_head(geometry, seed, noise, play=math.radians(play), points=points)
        begin = time.perf_counter()
        try:
            found = solve(geometry, CAMERA, head.views, None if points else SIZE)
        except CalibrationError:
            refused += 1
            continue
        times.append(time.perf_counter() - begin)
        before.append(math.degrees(pointing_error(geometry, head, np.zeros(10))))
        after.append(math.degrees(pointing_error(geometry, head, found.changes)))
        for parameter, truth in zip(PARAMETERS, head.changes, strict=True):
            estimate = found.estimates.get(parameter.name)
            if parameter.name.endswith("play") and estimate is not None:
                plays.append(abs(math.degrees(estimate.value - truth)))
            if estimate is not None and estimate.observable:
                inside.append(abs(estimate.value - truth) < 1.96 * estimate.deviation)
    rms = math.sqrt(np.mean(np.square(after)))
    return row(
        f"{_TARGETS[points]}, {noise:g} px, {play:g} degrees",
        f"{np.median(before):.2f}, {max(before):.2f} degrees",
        f"{np.median(after):.2f}, {max(after):.2f}; {rms:.2f} degrees",
        f"{100.0 * np.mean(inside):.1f} % of {len(inside)}; {refused}",
        f"{np.median(plays):.2f}, {max(plays):.2f} degrees",
        f"{np.median(times):.1f} s",
    )
