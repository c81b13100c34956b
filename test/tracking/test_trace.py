"""Traces of a head and its target, and the statistics of its errors."""

import math

import numpy as np
import pytest

from head_tracking.tracking import ErrorStatistics, Sample, Trace, TrackingJudge, lag, table


def swing(behind=0.1, seconds=8.0, period=0.02, rate=2.0):
    trace = Trace()
    for k in range(int(seconds / period)):
        t = k * period
        wanted, pan = math.sin(rate * t), math.sin(rate * (t - behind))
        trace.add(Sample(t, (wanted, 0.1), (pan, 0.1), abs(wanted - pan)))
    return trace


def test_figures_of_a_swing():
    trace = swing(seconds=10.0, period=0.004, rate=1.0)
    assert trace.rms == pytest.approx(2 * math.sin(0.05) / math.sqrt(2), rel=0.1)
    assert trace.maximum == pytest.approx(2 * math.sin(0.05), rel=0.01)
    assert trace.jerk() == pytest.approx(2 / math.pi, rel=0.1)
    speeds = trace.velocities(trace.wanted)
    assert speeds[:, 0] == pytest.approx(np.cos(trace.times), abs=0.01)
    assert trace.within(0.2) == 1.0


@pytest.mark.parametrize("behind", [-0.05, 0.0, 0.1, 0.3])
def test_how_far_the_head_is_behind(behind):
    assert lag(swing(behind)) == pytest.approx(behind, abs=0.006)


def test_the_table_has_the_figures():
    text = table(swing(), [0.04, 0.06], 29.97)
    rows = dict(line.split("  ", 1) for line in text.splitlines())
    assert rows["target"].strip() == "30.0 points/s, 50 ms old"
    assert f"{1e3 * swing().rms:.1f} mrad" in text
    assert rows["head behind its target"].strip() == "100 ms"
    assert "2.00 rad/s for a target at 2.00" in text


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
