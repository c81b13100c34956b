"""A head behind a late trajectory controller, instead of our servo bus."""

from itertools import pairwise

import pytest
from closed_loop import ClosedLoop, Conditions
from plant import Streamed
from runs import sine

from head_tracking.gaze import HeadCommand
from head_tracking.tracking import (
    LAWS,
    JointReading,
    SetpointStream,
    Tracker,
)


@pytest.mark.parametrize(("dead_time", "most"), [(0.05, 0.02), (0.2, 0.06)])
def test_a_target_is_followed_through_a_late_controller_for_good(head, dead_time, most):
    servos = Streamed(dead_time, stream=lambda: SetpointStream(0.02, 0.0))
    conditions = Conditions(duration=30.0, noise=0.002, servos=servos)
    tracker = Tracker(head, LAWS["predictive"](head, 0.02))
    recording = ClosedLoop(sine(0.5), conditions).run(tracker).recording
    assert recording.between(3.0).rms < most
    assert recording.between(20.0).rms < most


def stream(commands, *, obeys=True):
    """Return the positions sent for commands that come once a second."""
    stream, measured, sent = SetpointStream(0.02, 0.0), (0.0, 0.0), []
    for step in range(50 * len(commands)):
        command, now = commands[step // 50] if step % 50 == 0 else None, 0.02 * step
        positions = stream.positions(command, JointReading(now, measured), now)
        if positions is not None:
            sent.append(positions)
            measured = positions if obeys else measured
    return sent


def test_the_stream_approaches_a_goal_at_its_speed_and_ends():
    sent = stream([HeadCommand(0.3, -0.1, 1.0, 0.25)])
    assert sent[-1] == pytest.approx((0.3, -0.1))
    pans = [pan for pan, _ in sent]
    assert pans[0] == pytest.approx(0.05)
    assert max(b - a for a, b in pairwise(pans)) == pytest.approx(0.02)
    assert 13 <= len(sent) <= 22


def test_the_setpoint_of_a_joint_that_does_not_follow_returns_to_the_joint():
    sent = stream([HeadCommand(2.0, 0.0, 1.0, 1.0)] * 2, obeys=False)
    assert max(pan for pan, _ in sent) < 0.8
    assert sent[-1][0] < 0.1


def test_after_a_pause_the_stream_starts_at_the_measured_position():
    stream, measured = SetpointStream(0.02, 0.0), JointReading(5.0, (0.7, 0.0))
    stream.positions(HeadCommand(0.1, 0.0, 9.0, 9.0), JointReading(0.0, (0.0, 0.0)), 0.0)
    assert stream.positions(HeadCommand(1.0, 0.0, 1.0, 1.0), measured, 5.0) == (0.75, 0.0)
    stream.stop()
    assert stream.positions(None, measured, 5.1) is None
