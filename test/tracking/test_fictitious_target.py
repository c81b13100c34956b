import math

import pytest

from head_tracking.tracking import FictitiousTarget, FictitiousTargetParameters


def test_the_path_is_the_tutorials():
    target = FictitiousTarget(FictitiousTargetParameters())
    for index in range(600):
        t = 0.025 * index
        x, y, z = target.advance()
        assert x == pytest.approx(0.5 + 0.25 * math.sin(t))
        assert y == pytest.approx(0.5 * math.sin(t))
        assert z == pytest.approx(-0.1 + 0.5 * abs(math.sin(t)))


def test_without_amplitude_it_stands_still():
    still = FictitiousTargetParameters(center=(1.0, 2.0, 3.0), amplitude=(0.0, 0.0, 0.0))
    target = FictitiousTarget(still)
    assert {target.advance() for _ in range(50)} == {(1.0, 2.0, 3.0)}


def test_a_centre_needs_three_numbers():
    with pytest.raises(ValueError, match="center"):
        FictitiousTargetParameters(center=(1.0, 2.0))
