"""Hypotheses between which only noise differs are not decided."""

import numpy as np
import pytest

from head_tracking.tracking.hypothesis_bank import HypothesisBank


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_a_camera_and_of_an_encoder_decides_nothing(seed):
    """A target that stands still, 30 points a second; by one hypothesis tilt turns the other way.

    With a noise of 2 mrad for every camera, the difference was 9.6 to 19 in ten runs.
    """
    random, bank, most = np.random.default_rng(seed), HypothesisBank(2), 0.0
    for k in range(600):
        bearings = np.repeat(random.normal(0.0, 0.005, (2, 1)), 2, axis=1)
        tilt = random.normal(0.0, 0.002)
        bearings[1] += (tilt, -tilt)
        bank.add(k / 30.0, bearings, np.array([0.05, 0.05]), 0.0)
        most = max(most, abs(float(bank.scores[0] - bank.scores[1])))
    assert most < 10.0  # what calls a mounting wrong
