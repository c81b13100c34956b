"""Servos that are late, heavy or unlike each other, and a computer that is late."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from closed_loop import mx28
from plant import Deaf, Pair, PlainServo
from runs import BESIDE, LEVEL, ON_HEAD, around, run, sine, tracker

from head_tracking.tracking import Learning, LearningParameters

swing = sine(0.5)


def both(t):
    tilt = 0.15 * math.sin(math.pi * t + 1.0)
    return around(0.4 * math.sin(math.pi * t), LEVEL - 2.0 * math.tan(tilt))


LATE_AND_WEAK = PlainServo(dead_time=0.08, acceleration=15.0)


def wander(t):
    return around(float(np.interp(t, 0.02 * np.arange(len(BEARINGS)), BEARINGS)))


def wanderings():
    rng, velocity, bearings = np.random.default_rng(4), 0.0, [0.0]
    for push in rng.normal(0.0, 0.06, 2500):
        velocity += 0.02 * push / 0.02**0.5 - 0.02 * velocity / 0.7
        bearings.append(0.999 * bearings[-1] + 0.02 * velocity)
    return bearings


BEARINGS = wanderings()
LATE = {"duration": 12.0, "late": 0.1, "seed": 2}
SLOW = {"duration": 40.0, "points": 15.0, "servos": PlainServo()}


@pytest.mark.parametrize("play", ["gear_play", "link_play"])
def test_a_head_with_play_ends_at_the_same_place_from_left_and_right_and_rests(play):
    def loosen(servo):
        setattr(servo.drive.mechanics, play, math.radians(1.0))

    ends, conditions = [], replace(ON_HEAD, duration=34.0, servos=mx28(loosen))
    for side in (-1.0, 1.0):
        before, after = around(0.1 + 0.3 * side, LEVEL + 0.2 * side), around(0.1)
        outcome = run(lambda t, a=before, b=after: a if t < 3.0 else b, conditions)
        ends.append(outcome.recording.between(24.0).positions.mean(axis=0))
        rest = np.array(outcome.goals[1200:])  # the last 10 s
        assert np.count_nonzero(np.diff(rest, axis=0), axis=0).max() <= 5
    assert np.degrees(np.abs(ends[1] - ends[0])).max() < 0.1


@pytest.mark.parametrize(
    ("path", "changes", "start", "ratio", "farthest"),
    [
        (swing, {"duration": 12.0, "servos": LATE_AND_WEAK}, 4.0, 1.0, 1.0),
        (swing, {"duration": 12.0, "servos": PlainServo(profile=7.5)}, 4.0, 1.0, 1.0),
        (sine(1.0), LATE, 3.0, 0.8, 0.75),  # a late computer
        (wander, SLOW | {"noise": 0.001}, 0.0, 1.1, 1.0),  # 1.3 and 1.4 if the joints rest
        (wander, SLOW | {"noise": 0.003}, 0.0, 1.1, 1.0),
    ],
    ids=["late and weak", "profile", "late computer", "wanders", "wanders, noise"],
)
def test_the_simplest_law_is_not_better(path, changes, start, ratio, farthest):
    conditions = replace(BESIDE, **changes)
    ours, simplest = (
        run(path, conditions, tracker(law)).recording for law in ("predictive", "position")
    )
    assert ours.between(start).rms < ratio * simplest.between(start).rms
    assert abs(ours.positions).max() < farthest


@pytest.mark.parametrize("acceleration", [12.0, 20.0, 60.0])
def test_a_servo_stops_at_a_target_that_has_jumped(acceleration):
    servo = PlainServo(dead_time=0.018, lag=0.02, acceleration=acceleration, resolution=0.005)
    path = lambda t: around(0.25 if t % 3.0 < 1.5 else -0.25)  # noqa: E731
    recording = run(path, replace(BESIDE, servos=servo)).recording
    assert abs(recording.between(6.0).positions[:, 0]).max() < 0.25 + 0.06


@pytest.mark.parametrize(("seconds", "lag"), [(0.26, 0.03), (0.3, 0.07)])
def test_a_servo_that_hears_late_is_not_driven_past_its_target(seconds, lag):
    servo = PlainServo(dead_time=0.03, lag=lag, resolution=0.005)
    deaf = {"servos": lambda start: Deaf(servo(start), seconds)}
    conditions = replace(BESIDE, duration=3.0, noise=0.0, delay=0.02, **deaf)
    for target in (0.24, 0.36, 0.43):
        recording = run(lambda t, target=target: around(target), conditions).recording
        assert recording.positions[:, 0].max() < target + 0.06


def test_a_servo_with_a_long_lag_comes_to_rest():
    servo = PlainServo(profile=40.0, lag=0.077)
    conditions = replace(BESIDE, servos=servo, on_head=True, delay=0.1)
    recording = run(lambda t: around(0.3 if t > 2.0 else 0.0), conditions).recording
    standing = recording.between(6.0).positions[:, 0]
    assert standing.max() - standing.min() < 0.01
    assert recording.between(6.0).rms < 0.01


@pytest.mark.parametrize(("seconds", "every", "left"), [(0.9, 2.0, 0.4), (1.0, 3.0, 0.5)])
def test_a_weak_servo_does_not_swing_far_past_its_target(seconds, every, left):
    def path(t):
        way = min(t % every / seconds, 1.0)
        smooth = way**3 * (10.0 - 15.0 * way + 6.0 * way * way)
        return around(left * (2.0 * smooth - 1.0) * (-1.0) ** (t // every))

    conditions = replace(BESIDE, duration=20.0, servos=PlainServo(acceleration=4.0))
    assert abs(run(path, conditions).recording.positions[:, 0]).max() < 2.0 * left


def jumps(t):
    return around((-0.4, 0.3, 0.0, 0.5)[int(t / 2.0) % 4])


@pytest.mark.parametrize("acceleration", [5.0, 8.0, 60.0])
def test_the_acceleration_of_a_weak_servo_is_learned(acceleration):
    """A high one is not observable."""
    steered, servo = tracker(), PlainServo(acceleration=acceleration)
    run(jumps, replace(BESIDE, duration=14.0, servos=servo), steered)
    learned = steered.learned["head_pan_joint: acceleration"]
    if acceleration < 10.0:
        assert learned.value == pytest.approx(acceleration, rel=0.14)
    else:
        assert learned.source == "not observable"


def test_the_delay_of_a_servo_is_learned():
    """All are within 20 % after 10 s of slow motion; a stronger prior makes them too short."""
    servos = [PlainServo.drawn(random.Random(seed), (0.02, 0.1)) for seed in range(8)]
    errors = []
    for servo in servos:
        steered = tracker()
        run(sine(0.2), replace(BESIDE, duration=10.0, servos=servo), steered)
        delay = steered.learned["head_pan_joint: delay of its servo"].value
        errors.append(abs(delay / (servo.dead_time + servo.lag) - 1.0))
    assert max(errors) < 0.2
    assert np.median(errors) < 0.12


def test_each_joint_is_predicted_at_its_own_delay():
    servos = Pair(PlainServo(dead_time=0.15), PlainServo(dead_time=0.02))
    steered = tracker()
    recording = run(both, replace(BESIDE, servos=servos), steered).recording
    alike = run(both, replace(BESIDE, servos=PlainServo(dead_time=0.15))).recording
    assert recording.between(6.0).rms < 1.5 * alike.between(6.0).rms
    pan, tilt = steered.law.lead_times
    assert pan - tilt == pytest.approx(0.13, abs=0.02)
    learned = steered.learned
    assert max(learned[name].deviation for name in learned if "delay" in name) < 0.03


@pytest.mark.parametrize(
    ("servos", "camera"),
    [
        (Learning.LEARN, Learning.FREEZE),
        (Learning.FREEZE, Learning.LEARN),
        (Learning.FORGET, Learning.FORGET),
    ],
)
def test_what_was_learned_is_kept_or_forgotten_as_chosen(servos, camera):
    steered = tracker()
    before = steered.learned
    ordinary = replace(BESIDE, duration=8.0, servos=PlainServo(dead_time=0.02), on_head=True)
    run(swing, ordinary, steered)
    learned = steered.learned
    assert {each.source for each in learned.values()} >= {"learned"}
    steered.learn(LearningParameters(servos, camera))
    if servos is Learning.FORGET:
        assert steered.learned == before
    steered.reset("a new run")
    slow = PlainServo(dead_time=0.12)
    other = replace(ordinary, duration=12.0, servos=slow, stamp_error=0.09)
    run(swing, other, steered)
    now = steered.learned
    assert list(now) == list(learned)
    (pan, tilt), (*of_servos, stamps) = (name for name in now if "delay" in name), now
    if servos is not Learning.FREEZE:
        assert now[pan].value > learned[pan].value + 0.015
    else:
        assert now[tilt].value == learned[tilt].value
        assert now[pan].value == pytest.approx(learned[pan].value, abs=0.02)
        assert [now[name].source for name in of_servos] == [
            learned[name].source for name in of_servos
        ]
        assert now[pan].source == "learned"
    if camera is not Learning.FREEZE:
        assert now[stamps].value == pytest.approx(0.09, abs=0.02)
    else:
        assert (now[stamps].value, now[stamps].source) == (learned[stamps].value, "learned")
    steered.learn(LearningParameters(servo_delay=0.05, camera_delay=0.12))
    run(swing, replace(other, duration=1.0), steered)
    assert (steered.learned[pan].value, steered.learned[pan].source) == (0.05, "given")
    assert (steered.learned[stamps].value, steered.learned[stamps].source) == (0.12, "given")
