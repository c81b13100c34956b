"""Wrongly mounted servos: a camera on the head detects them, and the head stops."""

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
import runs
from closed_loop import START, WEBCAM, Mounted, ax12
from plant import PlainServo
from runs import HEAD, Watched, around, circle, run, tracker

from head_tracking.tracking import LAWS, JointReadings, TargetState, Tracker

WIDE = (5.0, 3.0)  # rad: a head that turns the wrong way keeps its target in view
ON_HEAD = replace(runs.ON_HEAD, duration=2.0, field=WIDE)
PAN_REVERSED = ((-1, 0), (0, 1))


def still(t):
    return around(0.3, 0.4)


def mounted(path, turns, note=lambda now, steered: None, steered=None, **changes):
    """Run a head whose servos turn it so; return the result and the tracker."""
    conditions = replace(ON_HEAD, servos=lambda start: Mounted(ax12()(start), turns), **changes)
    watched = Watched(steered or tracker(), note)
    return run(path, conditions, watched), watched.tracker


@pytest.mark.parametrize(
    ("law", "turns", "said"),
    [
        ("position", PAN_REVERSED, "head_pan_joint turns in"),
        ("predictive", ((1, 0), (0, -1)), "head_tilt_joint turns in"),
        ("predictive", ((-1, 0), (0, -1)), "head_pan_joint and head_tilt_joint turn in"),
        ("predictive", ((0, 1), (1, 0)), "swapped"),
        ("predictive", ((0, -1), (1, 0)), "swapped"),
        ("predictive", ((0, 1), (-1, 0)), "swapped"),
        ("predictive", ((0, -1), (-1, 0)), "swapped"),
    ],
)
def test_it_is_named_and_the_head_stops(law, turns, said):
    named = []

    def note(now, steered):
        if steered.camera.fault:
            named.append(now - START)

    outcome, steered = mounted(still, turns, note, tracker(law))
    assert said in steered.machine.reason
    assert steered.state is TargetState.IDLE
    trace = outcome.recording
    moved = trace.times[(abs(trace.positions - trace.positions[0]) > 0.1).any(axis=1)]
    assert named[0] - moved[0] < 0.4
    assert np.ptp(trace.between(named[0] + 0.3).positions, axis=0).max() < 0.01
    assert not any(now > named[0] + 1e-6 for now, _ in outcome.commands)


def test_it_goes_on_when_it_restarts_and_says_it_again():
    faults = []

    def restart(now, steered):
        if steered.camera.fault and now > START + 1.5 and len(faults) < 2:
            faults.append(steered.camera.fault)
            steered.restart()
            assert steered.camera.fault == ""
            assert steered.state is TargetState.IDLE

    mounted(still, PAN_REVERSED, restart, duration=3.0)
    assert len(faults) == 2
    assert faults[0] == faults[1] != ""


@pytest.mark.parametrize(("gain", "spell"), [(1.0, 9.0), (3.0, 0.5), (3.0, 9.0)])
def test_a_target_that_runs_from_the_head_is_not_taken_for_that(gain, spell):
    """It needs 150 ms to react; it runs for so long [s], and from its first moment on."""
    late, fled, faults, readings = deque(), [0.0], set(), JointReadings()

    def path(t):
        if late and t < spell:
            while len(late) > 1 and late[1][0] <= t - 0.15:
                late.popleft()
            fled[0] = gain * late[0][1]
        return around(0.3 + fled[0], 0.4)

    def note(now, steered):
        late.append((now - START, readings.latest.positions[0]))
        faults.add(steered.camera.fault)

    steered = Tracker(HEAD, LAWS["predictive"](HEAD, 0.02), readings=readings)
    mounted(path, ((1, 0), (0, 1)), note, steered, duration=4.0)
    assert faults == {""}


@pytest.mark.parametrize(
    ("frequency", "wide", "seed"), [(1.2, 0.25, 5), (1.2, 0.25, 6), (1.2, 0.25, 18), (2.0, 0.15, 3)]
)
def test_a_target_that_waves_is_not_taken_for_that(frequency, wide, seed):
    """No hypothesis predicts it: it begins at once, and each joint follows it late."""

    def path(t):
        phase, size = math.tau * frequency * (t - 1.0), wide * min(max(3.0 * (t - 1.0), 0.0), 1.0)
        return around(0.3 + size * math.sin(phase), 0.2 + 0.2 * size * math.sin(2.0 * phase), 1.2)

    servos = PlainServo(dead_time=0.02, lag=0.04, speed=5.0, acceleration=20.0)
    conditions = replace(
        WEBCAM, points=30.0, delay=0.2, duration=6.0, seed=seed, servos=servos, start=(0.3, -0.03)
    )
    steered = tracker()
    run(path, conditions, steered)
    assert steered.camera.fault == ""


def test_wrong_stamps_hide_it_from_nobody():
    _, steered = mounted(circle, ((0, 1), (1, 0)), duration=2.0, field=(2.0, 2.0), stamp_error=0.09)
    assert steered.camera.fault
