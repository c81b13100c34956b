import itertools
import math

import pytest

from head_tracking.gaze import Arrival
from head_tracking.targets import between

CENTRE = (0.1, 0.0, 0.5)


def ways(start, end, steps=50):
    return [between(start, end, i / steps, CENTRE) for i in range(steps + 1)]


@pytest.mark.parametrize(
    ("start", "end"),
    [((-0.5, 1, 0.5), (-0.5, -1, 0.2)), ((2, 0, 0), (0.5, 0.1, 1.5))],
)
def test_the_way_is_smooth_and_stays_away_from_the_head(start, end):
    points = ways(start, end)
    assert points[0] == pytest.approx(start)
    assert points[-1] == pytest.approx(end)
    nearest = min(math.dist(start, CENTRE), math.dist(end, CENTRE))
    assert min(math.dist(point, CENTRE) for point in points) > 0.99 * nearest
    steps = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    assert max(steps) < 3.2 * sum(steps) / len(steps)
    assert steps[0] < 0.2 * max(steps), "it starts without a jolt"


def test_the_way_from_left_to_right_goes_past_the_front():
    points = ways((-0.5, 1.0, 0.5), (-0.5, -1.0, 0.5))
    assert points[25][0] > 1.0


def test_arrived_is_who_stays():
    arrival = Arrival(0.02, 0.3)
    misses = [(0.0, 0.5), (0.1, 0.01), (0.2, 0.03), (0.3, 0.01), (0.4, 0.0), (5.0, 0.01)]
    assert not any(arrival.step(miss, now) for now, miss in misses), "a gap counts 0.1 s at most"
    assert not arrival.step(0.0, 5.05)
    assert arrival.step(0.0, 5.11)
