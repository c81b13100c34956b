import math

import pytest

from head_tracking.tracking import ErrorStatistics, Trace, TrackingJudge


def test_rms_and_maximum():
    statistics = ErrorStatistics()
    for error in (3.0, -4.0):
        statistics.add(error)
    assert statistics.rms == pytest.approx((25 / 2) ** 0.5)
    assert statistics.maximum == 4.0
    assert statistics.count == 2


def test_every_moment_is_judged_by_where_the_target_was_then(head):
    trace = Trace()
    judge = TrackingJudge(head, settling=0.0, trace=trace)

    def bearing(time):
        return 0.5 * math.sin(time)

    def looking(time):
        gaze = head.gaze((2.0 * math.cos(bearing(time)), 2.0 * math.sin(bearing(time)), 0.2), 0, 0)
        return gaze.pan, gaze.tilt

    for k in range(300):
        now = 0.02 * k
        judge.joints_read(now, looking(now))
        if k % 2 == 0 and now > 0.12:  # points come 120 ms late
            then = now - 0.12
            point = (2.0 * math.cos(bearing(then)), 2.0 * math.sin(bearing(then)), 0.2)
            judge.target_seen(then, point)
    assert judge.statistics.count > 250
    assert judge.statistics.rms < 1e-3
    assert len(trace) == judge.statistics.count
    assert trace.times[0] == pytest.approx(0.0, abs=0.02)
    assert trace.positions == pytest.approx(trace.wanted, abs=1e-3)


def test_a_target_that_is_told_once_is_judged_for_as_long_as_it_holds(head):
    judge = TrackingJudge(head, settling=0.5)
    judge.target_seen(0.0, (2.0, 0.0, 0.2))
    for k in range(200):
        judge.joints_read(0.02 * k, (0.5, 0.0))
    assert judge.error == pytest.approx(head.miss((2.0, 0.0, 0.2), 0.5, 0.0))
    assert 100 < judge.statistics.count < 160


def test_a_clock_that_jumps_back_is_no_reason_to_stop_judging(head):
    judge = TrackingJudge(head, settling=0.0)
    for start in (100.0, 5.0):
        for k in range(50):
            now = start + 0.02 * k
            judge.joints_read(now, (0.0, 0.0))
            judge.target_seen(now, (2.0, 0.0, 0.0))
    assert judge.statistics.count > 90
