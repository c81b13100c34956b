"""The choice among several sources of targets, and the change from one to the next."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.gaze import Arrival
from head_tracking.targets import MuxParameters, SourceParameters, TargetMux, between

SOURCES = {
    name: SourceParameters(priority=priority, timeout=0.5)
    for name, priority in (("low", 1), ("high", 5), ("equal", 1))
}


@pytest.fixture
def mux():
    return TargetMux(SOURCES, MuxParameters(take_over_time=0.3))


def test_a_source_that_publishes_once_takes_over_until_its_timeout():
    click = SourceParameters(priority=5, timeout=2.0, repeat=True)
    mux = TargetMux({**SOURCES, "click": click}, MuxParameters(take_over_time=0.3))
    mux.offer("low", 0.0)
    assert mux.offer("click", 0.0) == "low"
    assert mux.offer("low", 0.25) == "low"
    assert mux.offer("low", 0.35) == "click"
    assert mux.offer("low", 1.9) == "click"
    assert mux.select(2.1) == "low"


def test_an_unknown_pin_is_refused(mux):
    with pytest.raises(ValueError):
        mux.pin("hihg")


@given(st.lists(st.tuples(st.sampled_from(["low", "high", "equal"]), st.floats(0.01, 1.0))))
def test_whatever_is_chosen_has_a_target_and_it_is_never_nothing_if_there_is_one(events):
    mux = TargetMux(SOURCES, MuxParameters(take_over_time=0.3))
    now, last = 0.0, {}
    for name, pause in events:
        now += pause
        fresh = {other for other, when in last.items() if now - when <= 0.5}
        assert (mux.select(now) in fresh) == bool(fresh)
        mux.offer(name, now)
        last[name] = now
        assert mux.select(now) is not None


def test_a_clock_that_jumps_back_leaves_no_source_fresh(mux):
    for k in range(11):
        mux.offer("high", 1_000.0 + 0.1 * k)
    assert mux.select(5.0) is None
    assert mux.offer("low", 5.1) == "low"


CENTRE = (0.1, 0.0, 0.5)


@pytest.mark.parametrize(
    ("start", "end"),
    [((-0.5, 1, 0.5), (-0.5, -1, 0.2)), ((2, 0, 0), (0.5, 0.1, 1.5))],
)
def test_the_way_is_smooth_and_stays_away_from_the_head(start, end):
    points = [between(start, end, i / 50, CENTRE) for i in range(51)]
    assert points[0] == pytest.approx(start)
    assert points[-1] == pytest.approx(end)
    nearest = min(math.dist(start, CENTRE), math.dist(end, CENTRE))
    assert min(math.dist(point, CENTRE) for point in points) > 0.99 * nearest
    steps = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    assert max(steps) < 3.2 * sum(steps) / len(steps)
    assert steps[0] < 0.2 * max(steps), "it starts without a jolt"


def test_arrived_is_who_stays():
    arrival = Arrival(0.02, 0.3)
    misses = [(0.0, 0.5), (0.1, 0.01), (0.2, 0.03), (0.3, 0.01), (0.4, 0.0), (5.0, 0.01)]
    assert not any(arrival.step(miss, now) for now, miss in misses), "a gap counts 0.1 s at most"
    assert not arrival.step(0.0, 5.05)
    assert arrival.step(0.0, 5.11)
