"""A base that turns or drives under a target that stands still."""

import math

import pytest
from closed_loop import BASE_FRAME, ClosedLoop, Conditions
from plant import PlainServo

from head_tracking.tracking import LAWS, HeadBase, TargetState, Tracker

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


def error(head, base, fixed_frame="odom", duration=3.6, start=1.2):
    """Return the error while the base moves [rad rms]."""
    conditions = Conditions(
        duration=duration, points=25.0, delay=0.06, on_head=True, base=base, start=(0.4, 0.0),
        field=(6.3, 3.1), servos=PlainServo(), fixed_frame=fixed_frame,
    )  # fmt: skip
    loop = ClosedLoop(lambda t: WORLD, conditions)
    moves = fixed_frame == "odom"
    tracker = Tracker(
        head,
        LAWS["predictive"](head, 0.02),
        base=HeadBase(loop.buffer, "odom", head.base_frame) if moves else None,
    )
    recording = loop.run(tracker).recording.between(start)
    assert tracker.state is TargetState.TRACKING
    return recording.rms


@pytest.mark.parametrize(("base", "most"), [(turn, 0.005), (drive, 0.006), (stop_and_go, 0.03)])
def test_a_base_that_moves_costs_little_where_the_fixed_frame_stands_still(head, base, most):
    assert error(head, base) < most


def test_a_fixed_frame_is_better_than_one_that_turns_by_fits_and_starts(head):
    fixed, carried = (error(head, stop_and_go, frame) for frame in ("odom", BASE_FRAME))
    assert fixed < 0.75 * carried
