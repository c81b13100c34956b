"""Calibration of random heads: pointing errors, coverage of the intervals; late cameras."""

import math
import time
from itertools import product

import numpy as np
from closed_loop import ClosedLoop, Conditions, ax12
from frame import row, table
from plant import PlainServo
from random_head import CAMERA, SIZE, changes_of, kinectbot_geometry, pointing_error, random_head
from runs import around
from tracking.judging import tracker
from tracking.opponents import ReachyMini

from head_tracking.calibration.geometry import PARAMETERS
from head_tracking.calibration.solver import CalibrationError, solve

HEADS = 200
_DELAYS, _SEEDS = (0.15, 0.3, 0.45), range(6)
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


def camera_delay() -> str:
    """Return the table of a still face that is seen late, by heads that do not know how late."""
    return table(
        "a still face is seen so late | beyond the face: median, worst | with reachy_mini's "
        "arithmetic | within 1 degree for good, after the first image: median, worst | with "
        "reachy_mini's arithmetic",
        [_late(delay) for delay in _DELAYS],
    )


def _late(delay: float) -> str:
    """Return how a face is found whose images come late, stamped when they come."""
    cells: list[list[str]] = []
    for is_ours in (True, False):
        beyond, settled = [], []
        for bearing, servos, seed in product((0.3, 0.5, 0.8), (ax12(), PlainServo()), _SEEDS):
            conditions = Conditions(
                duration=8.0, noise=0.002, delay=delay, stamp_error=delay, on_head=True,
                field=(2.2, 1.5), seed=seed, servos=servos,
            )  # fmt: skip
            loop = ClosedLoop(lambda _, bearing=bearing: around(bearing), conditions)
            steered = tracker("predictive", loop, conditions) if is_ours else ReachyMini()
            found = loop.run(steered).recording
            off = np.degrees(found.positions[:, 0] - found.wanted[:, 0])
            away = found.times[np.abs(off) > 1.0] - found.times[0]
            beyond.append(max(0.0, off.max()))
            settled.append(away.max() - delay)
        cells.append([f"{np.median(each):.1f}, {max(each):.1f}" for each in (beyond, settled)])
    (ours, our_time), (others, their_time) = cells
    return row(
        f"{1e3 * delay:.0f} ms",
        *(f"{each} degrees" for each in (ours, others)),
        *(f"{each} s" for each in (our_time, their_time)),
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
        after.append(math.degrees(pointing_error(geometry, head, changes_of(found))))
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
