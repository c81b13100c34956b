"""What cameras, clocks and servos do to a head: it does not swing, and follows nearly as well."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from closed_loop import WEBCAM, ClosedLoop, Conditions
from plant import PlainServo
from runs import ON_HEAD, circle, from_rest, sine, still, swing, tracker


def error(head, path, conditions, start=3.0, law="predictive"):
    loop = ClosedLoop(path, conditions)
    return loop.run(tracker(head, law)).recording.between(start).rms


@pytest.mark.parametrize(
    ("law", "path"), [("predictive", still), ("speed", swing), ("position", swing)]
)
def test_stamps_that_are_wrong_make_no_head_swing(head, law, path):
    conditions = replace(ON_HEAD, rate=10.0 if law == "speed" else 50.0)
    usual = error(head, path, conditions, law=law)
    wrong = error(head, path, replace(conditions, stamp_error=-0.12), law=law)
    assert wrong < 4.0 * usual + 0.006


def test_a_camera_beside_the_head_has_no_stamp_errors_to_learn(head):
    steered = tracker(head)
    ClosedLoop(swing, replace(ON_HEAD, on_head=False)).run(steered)
    assert steered.camera.applied == 0.0


def walked_up(t):
    """Walk up to the head, and move on after a pause."""
    bearing, distance = 0.3 * math.sin(max(t - 32.0, 0.0)), max(3.0 - 1.2 * t, 0.5)
    return distance * math.cos(bearing), distance * math.sin(bearing), 0.16


LATE, HEAVY = PlainServo(dead_time=0.15), PlainServo(acceleration=5.0)


@pytest.mark.parametrize(
    ("path", "ordeal", "start", "most"),
    [
        (sine(0.5), {"servos": LATE}, 3.0, 0.04),
        (swing, {"servos": HEAVY, "duration": 20.0, "field": (3.0, 3.0)}, 14.0, 0.03),
        (circle, {"range_noise": 0.2}, 3.0, 0.01),
        (circle, {"outliers": 0.05, "outlier": 0.1, "seed": 2}, 3.0, 0.022),
        (sine(0.5), {"outliers": 0.09, "outlier": 1.5, "lost": 0.15, "seed": 2}, 3.0, 0.03),
        (walked_up, {"servos": PlainServo(), "duration": 38.0}, 33.0, 0.03),
    ],
    ids=["late servos", "heavy head", "distances", "outliers", "fast swing", "walked up"],
)
def test_the_head_follows_through_an_ordeal(head, path, ordeal, start, most):
    assert error(head, path, replace(ON_HEAD, **ordeal), start) < most


NOISY = replace(WEBCAM, duration=30.0, servos=PlainServo())


@pytest.mark.parametrize(
    ("conditions", "most"),
    [
        (Conditions(duration=12.0, noise=0.002, seed=1), 2.0),
        (Conditions(duration=12.0, noise=0.005, seed=2), 2.0),
        *((replace(NOISY, seed=seed), 1.2) for seed in (1, 3, 7)),
    ],
)
def test_at_rest_the_head_is_quieter_than_the_points(head, conditions, most):
    outcome = ClosedLoop(still, conditions).run(tracker(head))
    goals = outcome.goals[200:]
    assert sum(a != b for a, b in pairwise(goals)) / (len(goals) / 50.0) < most
    assert outcome.recording.between(4.0).rms < 0.003 + 0.5 * conditions.noise


def test_gaps_do_not_carry_the_head_past_its_target(head):
    gaps = tuple((start, start + 1.5) for start in (3.8, 6.1, 8.4, 10.7))
    conditions = replace(ON_HEAD, duration=12.0, servos=PlainServo(), gaps=gaps)
    recording = ClosedLoop(from_rest(0.5, 0.16), conditions).run(tracker(head)).recording
    assert abs(recording.positions[:, 0]).max() < 0.75
    assert recording.rms < 0.43
