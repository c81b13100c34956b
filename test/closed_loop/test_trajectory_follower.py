"""A head behind a late trajectory controller, instead of our servo bus."""

import math
from itertools import pairwise

import pytest
from closed_loop import ClosedLoop, Conditions
from plant import Streamed

from head_tracking.gaze import HeadCommand
from head_tracking.tracking import (
    LAWS,
    SetpointStream,
    Tracker,
)


def sine(t):
    bearing = 0.5 * math.sin(math.pi * t)
    return 2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 0.08


@pytest.mark.parametrize(("dead_time", "most"), [(0.05, 0.02), (0.1, 0.025), (0.2, 0.06)])
def test_a_target_is_followed_through_a_late_controller_for_good(head, dead_time, most):
    servos = Streamed(dead_time, stream=lambda: SetpointStream(0.02, 0.0))
    conditions = Conditions(duration=30.0, noise=0.002, servos=servos)
    tracker = Tracker(head, LAWS["predictive"](head, 0.02))
    recording = ClosedLoop(sine, conditions).run(tracker).recording
    assert recording.between(3.0).rms < most
    assert recording.between(20.0).rms < most


def stream(commands, start=(0.0, 0.0), period=0.02, ahead=0.0, obeys=True):
    """What is said for commands, each for a second, by joints that are where they were told."""
    made, measured, said = SetpointStream(period, ahead), start, []
    for number, command in enumerate(commands):
        for k in range(50):
            positions = made.positions(command if k == 0 else None, measured, number + 0.02 * k)
            if positions is not None:
                said.append(positions)
                measured = positions if obeys else measured
    return said


def test_a_goal_is_approached_at_its_speed_and_then_nothing_is_said():
    said = stream([HeadCommand(0.3, -0.1, 1.0, 0.25)])
    assert said[-1] == pytest.approx((0.3, -0.1))
    pans = [pan for pan, _ in said]
    assert pans[0] == pytest.approx(0.05)  # it comes after by some hundredths of a second
    assert max(b - a for a, b in pairwise(pans)) == pytest.approx(0.02)
    assert 13 <= len(said) <= 22


def test_a_joint_that_does_not_move_is_not_left_behind():
    said = stream([HeadCommand(2.0, 0.0, 1.0, 1.0)] * 2, obeys=False)
    assert max(pan for pan, _ in said) < 0.8
    assert said[-1][0] < 0.1


def test_a_joint_that_comes_late_does_not_hold_its_setpoint_back():
    made, said = SetpointStream(0.02, 0.0), []
    for k in range(60):
        measured = max(0.0, 2.0 * (0.02 * k - 0.3)) if k < 40 else 1.0
        command = HeadCommand(1.0, 0.0, 2.0, 2.0)
        said.append(made.positions(command, (min(measured, 1.0), 0.0), 0.02 * k))
    assert said[20][0] == pytest.approx(0.9, abs=0.01)
    assert said[30][0] == 1.0


def test_after_a_pause_it_begins_where_the_joint_is():
    made = SetpointStream(0.02, 0.0)
    made.positions(HeadCommand(0.1, 0.0, 9.0, 9.0), (0.0, 0.0), 0.0)
    assert made.positions(HeadCommand(1.0, 0.0, 1.0, 1.0), (0.7, 0.0), 5.0) == (0.75, 0.0)
    made.stop()
    assert made.positions(None, (0.7, 0.0), 5.1) is None
