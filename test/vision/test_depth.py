import numpy as np
import pytest

from head_tracking.vision import DepthImage, depth_picture
from head_tracking.vision.depth import surface_depth


def region(*parts, rng):
    """Depths of a region: each part is (how many, depth)."""
    depths = np.concatenate([np.full(count, depth) for count, depth in parts])
    noisy = depths + rng.normal(0, 0.003, depths.shape) * np.nan_to_num(depths) ** 2
    return rng.permutation(noisy).astype(np.float32)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.mark.parametrize(
    "parts",
    [
        [(100, 1.5)],
        [(70, 1.5), (30, np.nan)],
        [(60, 1.5), (40, 4.0)],
        [(60, 1.5), (25, 4.0), (15, 0.9)],
        [(20, 1.5), (80, np.nan)],
        [(55, 1.5), (45, 3.0)],
    ],
)
def test_the_thing_counts_and_not_what_is_behind_before_or_missing(rng, parts):
    found = surface_depth(region(*parts, rng=rng), 0.2, 8.0)
    assert found.metres == pytest.approx(1.5, abs=0.01)
    assert found.share == pytest.approx(parts[0][0] / 100, abs=0.02)


def test_the_mean_would_be_far_off(rng):
    depths = region((60, 1.5), (40, 4.0), rng=rng)
    assert abs(float(np.nanmean(depths)) - 1.5) > 0.9


def test_of_two_equal_surfaces_the_expected_one_is_taken(rng):
    depths = region((50, 1.5), (50, 3.0), rng=rng)
    assert surface_depth(depths, 0.2, 8.0).metres == pytest.approx(1.5, abs=0.01)
    assert surface_depth(depths, 0.2, 8.0, expected=2.9).metres == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize(
    "parts", [[(100, np.nan)], [(97, np.nan), (3, 1.5)], [(100, 0.1)], [(100, 9.0)], []]
)
def test_too_little_is_nothing(rng, parts):
    depths = region(*parts, rng=rng) if parts else np.zeros(0, np.float32)
    assert surface_depth(depths, 0.2, 8.0) is None


def test_depths_of_any_size_are_drawn():
    metres = np.array([[0.0, 1.0, 2.0], [3e38, np.nan, np.inf]], np.float32)
    with np.errstate(all="raise"):
        drawn = depth_picture(DepthImage(metres), 2.0)
    assert drawn[..., 0].tolist() == [[0, 127, 0], [0, 0, 0]]
