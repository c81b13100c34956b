"""Bounds of whole runs, from the first point to the end."""

import math
from dataclasses import replace

import numpy as np
import pytest
from closed_loop import ClosedLoop, Conditions
from plant import PlainServo, Streamed

from head_tracking.tracking import LAWS, HeadBase, SetpointStream, Tracker

GOOD = Conditions(duration=12.0, noise=0.002, delay=0.1, on_head=True, servos=PlainServo())


def around(bearing, distance=2.0):
    return distance * math.cos(bearing), distance * math.sin(bearing), 0.16


def swing(frequency, amplitude=0.5):
    """Begins at rest and comes to its speed within 2 s."""
    return lambda t: around(
        amplitude * math.sin(math.tau * frequency * (0.25 * t * t if t < 2.0 else t - 1.0))
    )


def run(head, path, conditions):
    loop = ClosedLoop(path, conditions)
    base = conditions.base and HeadBase(loop.buffer, "odom", head.base_frame)
    tracker = Tracker(head, LAWS["predictive"](head, 0.02), base=base)
    recording = loop.run(tracker).recording
    return recording.between(conditions.delay)


def test_a_person_who_walked_up_to_the_head_is_followed_after_a_pause(head):
    def path(t):
        return around(0.3 * math.sin(max(t - 32.0, 0.0)), max(3.0 - 1.2 * t, 0.5))

    trace = run(head, path, replace(GOOD, duration=38.0))
    assert trace.between(33.0).rms < 0.03


def test_a_base_that_sways_costs_little(head):
    def sway(t):
        return 0.0, 0.0, min(0.5 * t, 1.0) * 0.4 * math.sin(math.pi * t)

    assert run(head, lambda t: around(0.3), replace(GOOD, base=sway, start=(0.3, 0.0))).rms < 0.02


@pytest.mark.parametrize("seed", [1, 2])
def test_late_steps_do_not_carry_the_head_past_its_target(head, seed):
    assert run(head, swing(0.5), replace(GOOD, late=0.1, seed=seed)).rms < 0.08


def test_gaps_do_not_carry_the_head_past_its_target(head):
    gaps = tuple((t, t + 1.5) for t in np.arange(3.3, 11.0, 2.3))
    trace = run(head, swing(0.5), replace(GOOD, gaps=gaps))
    assert np.abs(trace.positions[:, 0]).max() < 0.65


def test_stamps_that_are_late_by_a_fifth_of_a_second_are_corrected(head):
    wrong = replace(GOOD, duration=20.0, stamp_error=0.2)
    assert run(head, swing(0.2), wrong).between(8.0).rms < 0.03


def test_a_trajectory_controller_with_a_long_dead_time_is_followed(head):
    servos = Streamed(0.2, stream=lambda: SetpointStream(0.02, 0.0))
    assert run(head, swing(0.5), replace(GOOD, duration=30.0, servos=servos)).rms < 0.06


def test_a_heavy_head_does_not_run_away(head):
    heavy = replace(GOOD, duration=20.0, servos=PlainServo(acceleration=10.0))
    assert run(head, swing(0.5), heavy).maximum < 0.3
