import math

import numpy as np
import pytest

from head_tracking.page.target_path import TargetPath

SECOND = 1_000_000_000


def filled(way, seconds=2.0, rate=25, ahead=0.5) -> TargetPath:
    path = TargetPath(ahead)
    for step in range(round(seconds * rate) + 1):
        path.add(SECOND + round(step / rate * SECOND), way(step / rate))
    return path


def circling(t: float) -> tuple[float, float, float]:
    return math.cos(t), math.sin(t), 0.5


def test_the_prediction_is_right_for_as_long_as_the_tracker_believes_in_it():
    path = filled(circling)
    for index, point in enumerate(path.predicted()[:7]):
        assert point == pytest.approx(circling(2.0 + index * 0.5 / 12), abs=0.02)


def test_what_the_head_sees_from_its_own_place_is_drawn_where_it_is():
    def way(t: float) -> tuple[float, float, float]:
        return 4.0 + 0.3 * t, 2.0, 1.0

    path = TargetPath(0.2, (3.0, 2.0, 0.5))
    for step in range(51):
        path.add(SECOND + round(step / 25 * SECOND), way(step / 25))
    assert path.predicted()[-1] == pytest.approx(way(2.2), abs=0.01)


def test_points_count_with_their_own_stamps():
    path = TargetPath(0.2)
    rng = np.random.default_rng(1)
    now = SECOND
    for step in range(60):
        stamp = SECOND + step * SECOND // 30
        now = stamp + round(rng.uniform(0.05, 0.07) * SECOND)  # they come when they come
        path.add(now, (1.0, 0.5 * step / 30, 0.5), stamp)
        path.add(now + 1000, (1.0, 0.5 * step / 30, 0.5), stamp)  # and are seen twice
    x, y, z = path.predicted()[-1]
    expected = 0.5 * ((now - SECOND) / SECOND + 0.2)
    assert y / x == pytest.approx(expected, abs=0.005)  # by the times of arrival it is 0.03 off
    assert z / x == pytest.approx(0.5, abs=0.005)
    assert x == pytest.approx(1.0, rel=0.05)  # the distance is estimated by itself, and lags


def test_a_target_at_rest_has_no_path_ahead():
    assert filled(lambda _: (1.0, 0.0, 0.5)).predicted() == []


def test_a_shaky_picture_of_a_target_at_rest_has_none_either():
    rng = np.random.default_rng(2)
    path = TargetPath(0.5)
    drawn = 0
    for step in range(250):
        path.add(SECOND + step * SECOND // 25, (1.0, *rng.normal(0.0, 0.003, 2)))
        drawn += step > 50 and bool(path.predicted())
    assert drawn < 20


def test_a_jump_is_another_target():
    path = filled(lambda t: (1.0, math.sin(t), 0.5))
    path.add(10 * SECOND, (-3.0, 0.0, 0.0))
    assert path.predicted() == []


def test_a_target_that_is_not_seen_any_more_is_expected_nowhere():
    path = filled(circling)
    last = circling(2.0)
    path.add(round(3.2 * SECOND), last, 3 * SECOND)
    assert path.predicted()
    path.add(round(3.6 * SECOND), last, 3 * SECOND)
    assert path.predicted() == []


def test_no_target_clears_it():
    path = filled(circling)
    path.add(4 * SECOND, None)
    assert path.predicted() == []


def test_a_recording_that_starts_again_is_shown_as_the_first_time():
    path = filled(circling)
    first = path.predicted()
    for step in range(51):
        path.add(SECOND + round(step / 25 * SECOND), circling(step / 25))
    assert path.predicted() == first
