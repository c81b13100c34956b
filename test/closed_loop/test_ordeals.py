"""What cameras, clocks and servos do to a head: it does not swing, and follows nearly as well."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from closed_loop import BASE_FRAME, WEBCAM, ClosedLoop, Conditions
from plant import PlainServo
from runs import HEAD, ON_HEAD, around, from_rest, run, sine, still, swing, tracker

from head_tracking.tracking import LAWS, HeadBase, JointReading, TargetState, Tracker


@pytest.mark.parametrize(
    ("law", "path"), [("predictive", still), ("speed", swing), ("position", swing)]
)
def test_stamps_that_are_wrong_make_no_head_swing(law, path):
    conditions = replace(ON_HEAD, rate=10.0 if law == "speed" else 50.0)
    usual, wrong = (
        run(path, each, tracker(law, each.rate)).recording.between(3.0).rms
        for each in (conditions, replace(conditions, stamp_error=-0.12))
    )
    assert wrong < 4.0 * usual + 0.006


def test_a_camera_beside_the_head_has_no_stamp_errors_to_learn():
    steered = tracker()
    run(swing, replace(ON_HEAD, on_head=False), steered)
    assert steered.camera.applied == 0.0


NOISY = replace(WEBCAM, duration=30.0, servos=PlainServo())


@pytest.mark.parametrize(
    ("conditions", "most"),
    [
        (Conditions(duration=12.0, noise=0.002, seed=1), 2.0),
        (Conditions(duration=12.0, noise=0.005, seed=2), 2.0),
        *((replace(NOISY, seed=seed), 1.2) for seed in (1, 3, 7)),
    ],
)
def test_at_rest_the_head_is_quieter_than_the_points(conditions, most):
    outcome = run(still, conditions)
    goals = outcome.goals[200:]
    assert sum(a != b for a, b in pairwise(goals)) / (len(goals) / 50.0) < most
    assert outcome.recording.between(4.0).rms < 0.003 + 0.5 * conditions.noise


def test_a_head_that_has_lost_an_exact_target_stands_still():
    conditions = Conditions(duration=6.0, points=25.0, delay=0.01, gaps=((1.6, 6.0),))
    head = run(lambda t: (1.0, 0.6, -0.3), conditions).recording.between(1.6).positions
    assert max(head.max(axis=0) - head.min(axis=0)) < 0.001


def test_clocks_may_begin_before_zero():
    law, there = LAWS["predictive"](HEAD, 0.02), (0.1, 0.0)
    for now in (-2000.0, -1999.98, -1999.96):
        command = law.go_to(there, 1.0, JointReading(now, there), now)
    assert command.pan == pytest.approx(0.1)


@pytest.mark.parametrize("seed", range(1, 4))
def test_a_face_that_sways_near_the_head_is_followed(seed):
    conditions = replace(
        NOISY, points=30.0, delay=0.05, delay_jitter=0.005, outliers=0.0, seed=seed
    )
    recording = run(sine(0.5, 0.013), conditions).recording.between(10.0)
    assert recording.rms < 0.006  # at rest beside it: 0.009


@pytest.mark.parametrize(("frequency", "most"), [(0.2, 0.015), (0.3, 0.02)])
def test_a_computer_that_is_often_late_follows_smoothly(frequency, most):
    conditions = replace(ON_HEAD, late=0.3, duration=20.0)
    assert run(sine(frequency), conditions).recording.between(3.0).rms < most


@pytest.mark.parametrize("seed", [8, 10])
def test_a_fast_target_without_points_does_not_take_the_camera_off_its_last_place(seed):
    usual = Conditions(points=30.0, delay=0.1, noise=0.002, duration=20.0)
    head = run(sine(0.5), replace(usual, lost=0.5, outage=0.3, seed=seed)).recording
    assert abs(head.positions[:, 0]).max() < 0.7


def test_gaps_do_not_carry_the_head_past_its_target():
    gaps = tuple((start, start + 1.5) for start in (3.8, 6.1, 8.4, 10.7))
    conditions = replace(ON_HEAD, duration=12.0, servos=PlainServo(), gaps=gaps)
    recording = run(from_rest(0.5, 0.16), conditions).recording
    assert abs(recording.positions[:, 0]).max() < 0.75
    assert recording.rms < 0.43


# A base that turns or drives under a target that stands still


def hurry(t):
    """Somebody crosses the view within 0.8 s, and stands."""
    way = min(max((t - 3.0) / 0.8, 0.0), 1.0)
    return around(0.5 - way**3 * (10.0 - 15.0 * way + 6.0 * way * way))


@pytest.mark.parametrize("hidden", [3.35, 3.4, 3.45, 3.5, 3.55, 3.6])
def test_who_stops_out_of_sight_is_found_again(hidden):
    """The prediction leads to a place from which the camera does not see them."""
    conditions = replace(ON_HEAD, servos=PlainServo(), gaps=((hidden, hidden + 1.2),))
    assert run(hurry, conditions).recording.between(8.0).rms < 0.01


WORLD = (3.0, 0.5, 0.2)  # m


def turn(t):
    """At 1 rad/s, from one side to the other."""
    return 0.0, 0.0, min(max(t - 2.0, -1.9), 1.9)


def drive(t):
    """An arc to and fro, at up to 1 rad/s."""
    yaw = math.sin(t)
    return 0.3 * math.sin(yaw), 0.1 * yaw, yaw


def stop_and_go(t):
    """It turns by 0.6 rad at up to 1 rad/s, stands for a while, and goes on."""
    turns, since = divmod(t, 1.2)
    if since < 0.25:
        way = 2.0 * since * since
    elif since < 0.6:
        way = 0.125 + since - 0.25
    else:
        way = 0.6 - 2.0 * max(0.85 - since, 0.0) ** 2
    return 0.0, 0.0, 0.6 * turns + way - 0.9


def moving_error(base, fixed_frame="odom"):
    """Return the error while the base moves [rad rms]."""
    conditions = Conditions(
        duration=3.6, points=25.0, delay=0.06, on_head=True, base=base, start=(0.4, 0.0),
        field=(6.3, 3.1), servos=PlainServo(), fixed_frame=fixed_frame,
    )  # fmt: skip
    loop = ClosedLoop(lambda t: WORLD, conditions)
    base = HeadBase(loop.buffer, "odom", HEAD.base_frame) if fixed_frame == "odom" else None
    steered = Tracker(HEAD, LAWS["predictive"](HEAD, 0.02), base=base)
    recording = loop.run(steered).recording.between(1.2)
    assert steered.state is TargetState.TRACKING
    return recording.rms


@pytest.mark.parametrize(
    ("base", "most"),
    [
        (turn, 0.005),
        (drive, 0.006),
        *((lambda t, begin=begin: stop_and_go(t + begin), 0.012) for begin in (0.0, 0.5, 0.6, 0.8)),
    ],
)
def test_a_base_that_moves_costs_little_where_the_fixed_frame_stands_still(base, most):
    assert moving_error(base) < most


def test_a_fixed_frame_is_better_than_one_that_turns_by_fits_and_starts():
    fixed, carried = (moving_error(stop_and_go, frame) for frame in ("odom", BASE_FRAME))
    assert fixed < 0.8 * carried
