import numpy as np
import pytest

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
        [(50, 1.5), (50, 3.0)],
    ],
)
def test_depth_of_the_largest_surface(rng, parts):
    assert surface_depth(region(*parts, rng=rng), 0.2, 8.0) == pytest.approx(1.5, abs=0.01)


@pytest.mark.parametrize(
    "parts", [[(100, np.nan)], [(97, np.nan), (3, 1.5)], [(100, 0.1)], [(100, 9.0)], []]
)
def test_too_few_depths_give_no_surface(rng, parts):
    depths = region(*parts, rng=rng) if parts else np.zeros(0, np.float32)
    assert surface_depth(depths, 0.2, 8.0) is None
