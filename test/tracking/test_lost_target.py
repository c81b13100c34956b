import pytest

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking import LostTargetParameters, LostTargetPolicy, TargetState


@pytest.fixture
def head(kinectbot):
    return PanTiltHead(kinectbot, "head_pan_joint", "head_tilt_joint", "camera_link")


def policy(head, **parameters):
    return LostTargetPolicy(head, LostTargetParameters(**parameters))


def test_before_the_first_target_nothing_moves(head):
    p = policy(head)
    for now in (0.0, 100.0, 1e6):
        assert p.step((0.5, 0.5), now) is None
    assert p.state is TargetState.IDLE


def test_while_the_target_is_seen_the_policy_keeps_out(head):
    p = policy(head)
    p.seen(1.0)
    assert p.step((0.5, 0.5), 1.9) is None
    assert p.state is TargetState.TRACKING


def test_a_lost_target_stops_the_head_where_it_is(head):
    p = policy(head)
    p.seen(0.0)
    command = p.step((0.5, 0.2), 1.1)
    assert (command.pan, command.tilt) == (0.5, 0.2)
    assert p.state is TargetState.HOLDING
    again = p.step((0.51, 0.2), 1.2)
    assert (again.pan, again.tilt) == (0.5, 0.2)


def test_after_the_timeout_it_recentres_slowly_and_then_is_silent(head):
    p = policy(head)
    p.seen(0.0)
    p.step((0.5, 0.2), 2.0)
    command = p.step((0.5, 0.2), 10.0)
    assert (command.pan, command.tilt) == (0.0, 0.0)
    assert command.pan_speed == 0.3
    assert p.state is TargetState.RECENTERING
    assert p.step((0.01, 0.0), 13.0) is None
    assert p.state is TargetState.IDLE
    assert p.step((0.5, 0.5), 14.0) is None  # somebody else moves the head now


def test_recentring_can_be_switched_off(head):
    p = policy(head, recenter_timeout=0.0)
    p.seen(0.0)
    assert p.step((0.5, 0.2), 1000.0).pan == 0.5


def test_the_search_sweeps_from_limit_to_limit(head):
    p = policy(head, enable_target_search=True)
    p.seen(0.0)
    assert p.step((0.0, 0.0), 10.0).pan == 2.6
    assert p.state is TargetState.SEARCHING
    assert p.step((2.5, 0.0), 18.0).pan == 2.6
    assert p.step((2.59, 0.0), 18.1).pan == -2.6
    assert p.step((-2.58, 0.0), 40.0).pan == 2.6


def test_a_target_interrupts_the_search_at_once(head):
    p = policy(head, enable_target_search=True)
    p.seen(0.0)
    p.step((0.0, 0.0), 10.0)
    p.seen(11.0)
    assert p.state is TargetState.TRACKING
    assert p.step((0.4, 0.0), 11.1) is None


def test_recentring_may_come_before_the_search(head):
    p = policy(head, enable_target_search=True, recenter_timeout=3.0)
    p.seen(0.0)
    assert p.step((0.5, 0.0), 4.0).pan == 0.0
    assert p.step((0.0, 0.0), 6.0) is None
    assert p.step((0.0, 0.0), 10.5).pan == 2.6
