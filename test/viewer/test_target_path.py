import math

import pytest

from head_tracking.viewer.target_path import TargetPath

SECOND = 1_000_000_000


def filled(way, seconds=2.0, rate=25, trail=5.0, ahead=0.5) -> TargetPath:
    path = TargetPath(trail, ahead)
    for step in range(round(seconds * rate) + 1):
        path.add(SECOND + round(step / rate * SECOND), way(step / rate))
    return path


def test_the_trail_forgets():
    path = filled(lambda t: (0.1 * t, 0.0, 1.0), seconds=10.0, trail=2.0)
    trail = path.trail()
    assert trail[-1] == pytest.approx((1.0, 0.0, 1.0))
    assert trail[0] == pytest.approx((0.8, 0.0, 1.0))


def test_constant_acceleration_is_predicted_exactly():
    def way(t: float) -> tuple[float, float, float]:
        return (1.0 + 0.2 * t * t, 0.3 * t, 0.5)

    predicted = filled(way, seconds=1.0).predicted()
    assert predicted[0] == pytest.approx(way(1.0))
    assert predicted[-1] == pytest.approx(way(1.5), abs=1e-6)


def test_a_target_at_rest_has_no_path_ahead():
    assert filled(lambda _: (1.0, 0.0, 0.5)).predicted() == []


def test_a_jump_is_another_target():
    path = filled(lambda t: (1.0, math.sin(t), 0.5))
    path.add(10 * SECOND, (-3.0, 0.0, 0.0))
    assert path.trail() == [(-3.0, 0.0, 0.0)]
    assert path.predicted() == []


def test_no_target_clears_it_and_old_stamps_start_anew():
    path = filled(lambda t: (1.0, t, 0.5), seconds=0.2)
    path.add(SECOND // 2, (1.0, 0.0, 0.5))
    assert len(path.trail()) == 1
    path.add(SECOND, None)
    assert path.trail() == []
