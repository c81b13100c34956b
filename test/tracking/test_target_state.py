"""The states of a target: seen, lost, searched for."""

from itertools import pairwise

import pytest

from head_tracking.gaze import Gaze, GazeStatus
from head_tracking.tracking import TargetState, TargetStateMachine, TargetStateParameters
from head_tracking.tracking.search import Sweep

REACHED = Gaze(0.0, 0.0, GazeStatus.REACHED, 0.0)
HERE, THERE = (0.5, 0.2), (0.3, 0.1)


def there():
    return THERE


@pytest.fixture
def make(head):
    return lambda **parameters: TargetStateMachine(head, TargetStateParameters(**parameters))


def seen(life, until=1.0):
    """Points 30 times a second, followed on the target."""
    for k in range(int(until * 30) + 1):
        life.seen(k / 30, new=k == 0)
        life.followed(REACHED, 0.001, k / 30)
    return k / 30


def test_a_slow_stream_of_points_is_no_loss(make):
    life = make()
    for k in range(40):
        life.seen(0.4 * k, new=k == 0)
    life.followed(REACHED, 0.01, 0.4 * k + 0.39)
    assert life.state is TargetState.TRACKING


def test_where_a_lost_target_should_be_the_head_waits_for_it(make, head):
    life = make()
    last = seen(life)
    assert not life.follows(last + 0.5, 0.5)
    assert life.goal(HERE, there, last + 0.6) == THERE
    assert life.goal((0.51, 0.2), there, last + 0.7) == THERE
    assert life.goal(HERE, lambda: (9.0, 0.2), last + 0.8) == (head.pan_limits.upper, 0.2)
    assert life.state is TargetState.HOLDING


def test_a_target_at_an_unknown_place_does_not_keep_the_head_from_its_centre(make):
    life = make()
    last = seen(life)
    assert life.goal(HERE, lambda: None, last + 1.0) is None
    assert life.state is TargetState.HOLDING
    assert life.goal(HERE, lambda: None, last + 10.0) == (0.0, 0.0)


@pytest.mark.parametrize("error", [0.2, 1.5])
def test_the_head_is_on_the_target_only_while_it_is(make, error):
    life = make()
    last = seen(life)
    assert life.state is TargetState.TRACKING
    for k in range(30):
        life.seen(last + k / 30, new=False)
        life.followed(REACHED, error, last + k / 30)
    assert life.state is TargetState.ACQUIRING


def test_a_moment_off_the_target_is_no_new_acquisition(make):
    life = make()
    last = seen(life)
    life.followed(REACHED, 0.2, last + 0.02)
    assert life.state is TargetState.TRACKING


def test_why_targets_are_refused_stands_behind_the_reason_until_one_is_taken(make):
    life = make()
    life.refused("the frame 'nose' does not exist", 0.5)
    life.refused("something else", 0.6)  # nobody could read the first one so fast
    assert life.state is TargetState.IDLE
    assert life.reason == (
        "no target has come yet; a target was refused: the frame 'nose' does not exist"
    )
    life.refused("something else", 2.0)
    assert "something else" in life.reason
    life.seen(3.0, new=True)
    assert "something else" in life.reason
    life.seen(4.1, new=False)
    assert life.reason == "a new target has come"


def test_the_whole_field_is_swept_row_by_row(head):
    sweep, corners = Sweep(head), [(0.0, 0.0)]
    for _ in range(40):  # it jumps to wherever it is sent
        corners.append(sweep.goal(corners[-1]))
    del corners[0]
    pans, tilts = {pan for pan, _ in corners}, {tilt for _, tilt in corners}
    assert pans == {head.pan_limits.lower, head.pan_limits.upper}
    rows = sorted(tilts)
    assert rows[0] - head.tilt_limits.lower <= 0.36
    assert head.tilt_limits.upper - rows[-1] <= 0.36
    assert all(b - a <= 0.71 for a, b in pairwise(rows))
