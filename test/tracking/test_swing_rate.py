import numpy as np
import pytest
from head_tracking.tracking.swing_rate import SwingRate


def learn(path, seconds=4.0, noise=0.0, times=None):
    rng = np.random.default_rng(1)
    rate, stamps, points = SwingRate.unknown(2), [], []
    for t in np.arange(0.0, seconds, 1 / 30) if times is None else times:
        stamps.append(float(t))
        points.append(np.asarray(path(t)) + noise * rng.normal(size=2))
        rate = rate.learned(stamps, points, np.full(2, max(noise, 1e-6) ** 2))
    return rate.rate


@pytest.mark.parametrize("frequency", [0.2, 0.5, 1.0, 2.0])
def test_each_coordinate_has_its_own_rate(frequency):
    w = 2 * np.pi * frequency
    found = learn(lambda t: (3.0 + np.sin(w * t), 0.5 * np.cos(1.2 * w * t)))
    assert found == pytest.approx([w, 1.2 * w], rel=0.03)


def test_noise_brings_no_bias():
    w = 2 * np.pi * 0.5
    assert learn(lambda t: (np.sin(w * t), np.cos(w * t)), 8.0, 0.004) == pytest.approx(
        [w, w], rel=0.05
    )


def test_irregular_points_do():
    w = 2 * np.pi * 0.5
    times = np.cumsum(np.random.default_rng(2).uniform(0.01, 0.06, 150))
    assert learn(lambda t: (np.sin(w * t), np.cos(w * t)), times=times) == pytest.approx(
        [w, w], rel=0.05
    )


def test_what_stands_still_or_moves_straight_does_not_swing():
    assert learn(lambda t: (0.3, 1.0), noise=0.002).tolist() == [0.0, 0.0]
    assert learn(lambda t: (0.3 * t, -t)) == pytest.approx([0.0, 0.0], abs=0.05)
