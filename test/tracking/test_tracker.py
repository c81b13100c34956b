"""The tracker with an ideal servo; the real ones are in test/closed_loop."""

import math

import pytest
from ideal_head import DT, IdealHead

from head_tracking.tracking import (
    LAWS,
    FollowingWatch,
    SpeedLimits,
    TargetState,
    TargetStateParameters,
    Tracker,
)

TARGET = (1.0, 0.6, -0.2)


@pytest.fixture(params=sorted(LAWS))
def law(request):
    return request.param


@pytest.fixture
def make(head):
    def make(law="predictive", **life):
        limits = SpeedLimits(max_joint_speed=2.0)
        tracker = Tracker(head, LAWS[law](head, DT, limits))
        tracker.machine.parameters = TargetStateParameters(**life)
        return tracker

    return make


def test_nothing_is_commanded_before_the_joints_are_known(make):
    tracker = make()
    tracker.target_seen(1.0, TARGET, 1.0)
    assert tracker.step(1.0).command is None
    assert tracker.restart() is None


def test_a_point_that_is_published_once_is_followed_after_another_target(make, law):
    ideal = IdealHead(make(law)).run(2.0, (1.0, 0.0, 0.0)).run(2.0)
    ideal.tracker.target_seen(ideal.now, TARGET, ideal.now)
    assert abs(ideal.positions[0]) < 0.02
    ideal.run(0.6)
    assert ideal.positions[0] > 0.1


def test_a_target_behind_the_head_is_no_reason_to_hunt(make):
    ideal = IdealHead(make()).run(4.0, (-2.0, 0.3, 0.0))
    assert ideal.tracker.state is TargetState.AT_LIMIT
    assert ideal.positions[0] == pytest.approx(ideal.tracker.head.pan_limits.upper, abs=0.02)
    # it wanders across to the other side of the back, and the head stays
    ideal.run(2.0, (-2.0, -0.1, 0.0))
    assert ideal.positions[0] == pytest.approx(ideal.tracker.head.pan_limits.upper, abs=0.02)


def test_one_that_flickers_at_the_far_edge_is_not_chased_all_the_way_round(make):
    ideal = IdealHead(make()).run(4.0, (-2.0, 0.3, 0.0))
    edge = ideal.tracker.head.pan_limits.lower
    for k in range(60):
        angle = edge + (0.02 if k % 2 else -0.02)
        ideal.run(DT, (2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.0))
    assert ideal.positions[0] > 2.0
    ideal.run(6.0, (2.0 * math.cos(edge + 0.3), 2.0 * math.sin(edge + 0.3), 0.0))
    assert ideal.positions[0] == pytest.approx(edge + 0.3, abs=0.03)


def test_a_target_ends_the_recentring_for_good(make):
    ideal = IdealHead(make()).run(2.0, TARGET)
    ideal.tracker.recenter()
    ideal.run(0.1).run(2.0, TARGET)
    assert ideal.tracker.state is TargetState.TRACKING
    assert ideal.run(2.0).tracker.state is TargetState.HOLDING


def test_a_head_that_did_not_obey_yet_is_recentred_from_where_it_stands(make, law):
    ideal = IdealHead(make(law))
    ideal.obeys = False  # a servo's delay is longer than this
    ideal.run(DT, TARGET).tracker.recenter()
    ideal.run(0.1)
    ideal.obeys = True
    assert ideal.run(2.0).positions == pytest.approx((0.0, 0.0), abs=0.02)


def test_delays_are_measured(make):
    tracker = make()
    for k in range(200):
        now = 100.0 + 0.02 * k
        tracker.joints_read(now - 0.005, (0.0, 0.0))
        if k % 2 == 0:
            tracker.target_seen(now - 0.08, TARGET, now)
        tracker.step(now)
    assert tracker.message_age == pytest.approx(0.08, abs=1e-6)
    assert tracker.reading_age == pytest.approx(0.005, abs=1e-3)
    assert tracker.interval == pytest.approx(0.04, rel=0.1)
    assert all(0.0 < delay < 0.15 for delay in tracker.law.delays)


def test_joints_that_are_not_measured_are_not_taken_for_stalled(make, law):
    ideal = IdealHead(make(law)).run(0.04, TARGET)
    for _ in range(100):
        ideal.now += DT
        ideal.tracker.target_seen(ideal.now, TARGET, ideal.now)
        ideal.tracker.step(ideal.now)
        assert ideal.tracker.state is not TargetState.STALLED


@pytest.mark.parametrize(("period", "fewest"), [(0.02, 16), (0.1, 8)])
def test_a_joint_that_is_measured_rarely_gets_time_to_start(period, fewest):
    """On a busy machine the servo gets its commands late, too."""
    watch = FollowingWatch(0.3)
    standing = [watch.check(1.0, 0.5, 0.0, period * k) for k in range(40)]
    assert fewest <= standing.index(True) <= fewest + 2
