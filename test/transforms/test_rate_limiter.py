import random

import pytest

from head_tracking.transforms import RateLimiter

SECOND = 1_000_000_000


def accepted(limiter: RateLimiter, stamps) -> int:
    return sum(limiter.accept(round(stamp * SECOND)) for stamp in stamps)


def test_a_stream_at_the_same_frequency_passes_whole_however_it_jitters():
    """robot_state_publisher would halve it."""
    rnd = random.Random(1)
    stamps = [100 + index / 20 + rnd.uniform(-0.02, 0.02) for index in range(400)]
    assert accepted(RateLimiter(20.0), stamps) == 400


@pytest.mark.parametrize("rate", [21, 50, 1000])
def test_faster_streams_are_thinned_to_the_frequency(rate):
    stamps = [100 + index / rate for index in range(10 * rate)]
    assert accepted(RateLimiter(20.0), stamps) == pytest.approx(200, abs=2)


def test_stamps_that_go_back_are_refused_unless_they_are_to_be_ignored():
    limiter = RateLimiter(20.0)
    assert limiter.accept(10 * SECOND)
    assert not limiter.accept(10 * SECOND - SECOND // 2)
    assert not limiter.accept(10 * SECOND)
    careless = RateLimiter(20.0, ignore_timestamp=True)
    assert careless.accept(10 * SECOND)
    assert careless.accept(5 * SECOND)
    assert careless.accept(5 * SECOND + SECOND // 20)


def test_a_clock_that_jumps_back_begins_anew():
    limiter = RateLimiter(20.0)
    assert accepted(limiter, [1000 + index / 100 for index in range(100)]) in (20, 21)
    assert accepted(limiter, [5 + index / 100 for index in range(100)]) in (20, 21)
