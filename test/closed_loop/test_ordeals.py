"""What cameras, clocks and servos do to a head: it does not swing, and follows nearly as well."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import pytest
from closed_loop import ClosedLoop, Conditions
from plant import PlainServo
from runs import around, circle, sine, still, swing, tracker

ON_HEAD = Conditions(duration=10.0, noise=0.002, delay=0.1, on_head=True)


@cache
def error(head, path, conditions, start=3.0, law="predictive"):
    loop = ClosedLoop(path, conditions)
    return loop.run(tracker(head, law)).recording.between(start).rms


@pytest.mark.parametrize(
    ("law", "path", "late"),
    [
        ("predictive", still, -0.12),
        ("predictive", swing, 0.05),
        ("speed", swing, -0.12),
        ("position", swing, -0.12),
    ],
)
def test_stamps_that_are_wrong_make_no_head_swing(head, law, path, late):
    conditions = replace(ON_HEAD, rate=10.0 if law == "speed" else 50.0)
    usual = error(head, path, conditions, law=law)
    wrong = error(head, path, replace(conditions, stamp_error=late), law=law)
    assert wrong < (1.5 if abs(late) < 0.1 else 4.0) * usual + 0.006


def test_a_camera_beside_the_head_has_no_stamp_errors_to_learn(head):
    steered = tracker(head)
    ClosedLoop(swing, replace(ON_HEAD, on_head=False)).run(steered)
    assert steered.camera.applied == 0.0


@pytest.mark.parametrize("path", [still, circle])
def test_noise_of_the_distance_does_not_turn_the_head(head, path):
    noisy = error(head, path, replace(ON_HEAD, range_noise=0.2))
    assert noisy < 1.5 * error(head, path, ON_HEAD) + 0.003


@pytest.mark.parametrize(("path", "size", "seed"), [(swing, 0.15, 1), (circle, 0.1, 2)])
def test_outliers_do_not_carry_the_head_away(head, path, size, seed):
    wild = replace(ON_HEAD, outliers=0.05, outlier=size, seed=seed)
    # without outliers the error is a few mrad, and a ratio to it alone would say little
    assert error(head, path, wild) < max(1.8 * error(head, path, ON_HEAD) + 0.01, 0.022)


@pytest.mark.parametrize("dead_time", [0.1, 0.15])
def test_servos_with_a_long_dead_time_are_followed(head, dead_time):
    fast = replace(ON_HEAD, servos=PlainServo(dead_time=dead_time))
    assert error(head, sine(0.5), fast) < 0.04


def test_a_heavy_head_follows_what_it_can(head):
    servos = PlainServo(acceleration=5.0)
    heavy = replace(ON_HEAD, duration=20.0, field=(3.0, 3.0), servos=servos)
    assert error(head, swing, heavy, start=14.0) < 0.03


def test_outliers_on_a_fast_swing_do_not_stop_the_pursuit(head):
    fast = replace(ON_HEAD, duration=14.0, outliers=0.05, outlier=0.5)
    for seed in (1, 2):
        conditions = replace(fast, seed=seed)
        assert error(head, sine(0.5), conditions) < 0.05


@pytest.mark.parametrize(("noise", "seed"), [(0.002, 1), (0.005, 2), (0.005, 3)])
def test_at_rest_the_head_is_quieter_than_the_points(head, noise, seed):
    conditions = Conditions(duration=12.0, noise=noise, seed=seed)
    outcome = ClosedLoop(still, conditions).run(tracker(head))
    goals = outcome.goals[200:]
    changes = sum(a != b for a, b in pairwise(goals)) / (len(goals) / 50.0)
    assert changes < 2.0
    assert outcome.recording.between(4.0).rms < 0.003 + 0.5 * noise


def test_a_person_who_walked_up_to_the_head_is_followed_after_a_pause(head):
    def path(t):
        bearing, distance = 0.3 * math.sin(max(t - 32.0, 0.0)), max(3.0 - 1.2 * t, 0.5)
        return distance * math.cos(bearing), distance * math.sin(bearing), 0.16

    conditions = replace(ON_HEAD, duration=38.0, servos=PlainServo())
    assert error(head, path, conditions, start=33.0) < 0.03


@pytest.mark.parametrize("later", [0.0, 0.5])
def test_gaps_do_not_carry_the_head_past_its_target(head, later):
    def path(t):  # it begins at rest and comes to its speed within 2 s
        return around(0.5 * math.sin(math.pi * (0.25 * t * t if t < 2.0 else t - 1.0)), 0.16)

    gaps = tuple((start + later, start + later + 1.5) for start in (3.3, 5.6, 7.9, 10.2))
    conditions = replace(ON_HEAD, duration=12.0, servos=PlainServo(), gaps=gaps)
    recording = ClosedLoop(path, conditions).run(tracker(head)).recording
    assert abs(recording.positions[:, 0]).max() < 0.75
    assert recording.rms < 0.43
