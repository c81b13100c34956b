"""Servos that are late, heavy or unlike each other, and a computer that is late."""

import math
from dataclasses import replace

import pytest
from closed_loop import ClosedLoop, Conditions
from plant import Pair, PlainServo

from head_tracking.tracking import LAWS, Tracker


def around(pan, tilt=0.0):
    return 2.0 * math.cos(pan), 2.0 * math.sin(pan), 0.08 - 2.0 * math.tan(tilt)


def swing(t):
    return around(0.5 * math.sin(math.pi * t))


def both(t):
    return around(0.4 * math.sin(math.pi * t), 0.15 * math.sin(math.pi * t + 1.0))


def tracker(head, law="predictive"):
    return Tracker(head, LAWS[law](head, 0.02))


def run(head, path, conditions, law="predictive"):
    steered = tracker(head, law)
    return ClosedLoop(path, conditions).run(steered).recording, steered


BESIDE = Conditions(duration=16.0, noise=0.002, delay=0.05, field=(3.0, 3.0))


@pytest.mark.parametrize(
    "servo",
    [
        PlainServo(dead_time=0.08, acceleration=15.0),
        PlainServo(profile=20.0),
        PlainServo(profile=7.5),
        PlainServo(dead_time=0.1, acceleration=20.0),
    ],
)
def test_a_servo_that_accelerates_slowly_does_not_run_away(head, servo):
    ours, _ = run(head, swing, replace(BESIDE, servos=servo))
    simple, _ = run(head, swing, replace(BESIDE, servos=servo), "position")
    assert abs(ours.positions).max() < 1.0
    assert ours.between(4.0).rms < simple.between(4.0).rms


@pytest.mark.parametrize("seed", [1, 2])
def test_a_late_computer_does_not_carry_the_head_past_its_target(head, seed):
    late = replace(BESIDE, late=0.1, seed=seed)
    for path, reach in ((swing, 0.5), (lambda t: around(0.5 * math.sin(math.tau * t)), 0.5)):
        ours, _ = run(head, path, late)
        simple, _ = run(head, path, late, "position")
        assert ours.between(3.0).rms < 0.8 * simple.between(3.0).rms
        assert abs(ours.between(3.0).positions[:, 0]).max() < reach + 0.25


def test_a_servo_with_a_long_lag_comes_to_rest(head):
    servo = PlainServo(profile=40.0, lag=0.077)
    conditions = replace(BESIDE, servos=servo, on_head=True, delay=0.1)
    recording, _ = run(head, lambda t: around(0.3 if t > 2.0 else 0.0), conditions)
    standing = recording.between(6.0).positions[:, 0]
    assert standing.max() - standing.min() < 0.01
    assert recording.between(6.0).rms < 0.01


def test_each_joint_is_predicted_at_its_own_delay(head):
    servos = Pair(PlainServo(dead_time=0.15), PlainServo(dead_time=0.02))
    recording, steered = run(head, both, replace(BESIDE, servos=servos))
    alike, _ = run(head, both, replace(BESIDE, servos=PlainServo(dead_time=0.15)))
    assert recording.between(6.0).rms < 1.5 * alike.between(6.0).rms
    pan, tilt = steered.law.lead_times
    assert pan - tilt == pytest.approx(0.13, abs=0.02)
    deviations = steered.delays.deviations
    assert max(deviations) < 0.03
