import math

import pytest

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking import (
    LostTargetParameters,
    LostTargetPolicy,
    SpeedLaw,
    SpeedLawParameters,
    TargetState,
    Tracker,
)


@pytest.fixture
def tracker(kinectbot):
    head = PanTiltHead(kinectbot, "head_pan_joint", "head_tilt_joint", "camera_link")
    return Tracker(
        head,
        SpeedLaw(SpeedLawParameters(k_pan=4.0, k_tilt=4.0, max_joint_speed=2.0)),
        LostTargetPolicy(head, LostTargetParameters()),
    )


def run(tracker, target, present, start, steps, dt=0.05):
    """An ideal servo: each joint moves at the commanded speed towards its goal."""
    for step in range(steps):
        now = start + step * dt
        if target is not None:
            tracker.target_seen(target, now)
        command = tracker.step(present, now).command
        if command is not None:
            present = tuple(
                here + math.copysign(min(abs(goal - here), speed * dt), goal - here)
                for here, goal, speed in zip(
                    present,
                    (command.pan, command.tilt),
                    (command.pan_speed, command.tilt_speed),
                    strict=True,
                )
            )
    return present


def test_nothing_moves_before_a_target_comes(tracker):
    assert tracker.step((0.4, 0.4), 100.0).command is None


def test_it_turns_to_the_target_and_stays(tracker):
    target = (1.0, 0.6, -0.2)
    present = run(tracker, target, (0.0, 0.0), 0.0, 60)
    assert tracker.head.miss(target, *present) < 0.02
    assert tracker.state is TargetState.TRACKING


def test_the_error_is_judged_by_the_measured_joints(tracker):
    tracker.target_seen((1.0, 0.0, 0.1), 0.0)
    step = tracker.step((0.5, 0.0), 0.0)
    assert step.error == pytest.approx(tracker.head.miss((1.0, 0.0, 0.1), 0.5, 0.0))


def test_a_target_behind_the_head_stops_it(tracker):
    present = run(tracker, (1.0, 0.6, -0.2), (0.0, 0.0), 0.0, 4)
    tracker.target_seen((-2.0, 0.0, 0.0), 1.0)
    step = tracker.step(present, 1.0)
    assert "out of reach" in step.gaze.reason
    assert (step.command.pan, step.command.tilt) == present
    assert tracker.step((present[0] + 0.1, 0.0), 1.05).command.pan == present[0]


def test_a_target_that_goes_away_stops_the_head_and_comes_back(tracker):
    present = run(tracker, (1.0, 0.6, -0.2), (0.0, 0.0), 0.0, 5)
    held = tracker.step(present, 5.0)
    assert (held.command.pan, held.command.tilt) == present
    assert held.error is None
    assert tracker.state is TargetState.HOLDING
    present = run(tracker, (1.0, -0.6, -0.2), present, 6.0, 60)
    assert tracker.head.miss((1.0, -0.6, -0.2), *present) < 0.02


def test_stop_forgets_the_target(tracker):
    tracker.target_seen((1.0, 0.6, 0.0), 0.0)
    assert tracker.stop((0.2, 0.1)).pan == 0.2
    assert tracker.step((0.2, 0.1), 0.1).command is None
    assert tracker.state is TargetState.IDLE


def test_recenter_forgets_the_target_too(tracker):
    tracker.target_seen((1.0, 0.6, 0.0), 0.0)
    command = tracker.recenter((1.0, 0.5))
    assert (command.pan, command.tilt, command.pan_speed) == (0.0, 0.0, 0.3)
    assert tracker.step((0.9, 0.4), 0.1).command is None
