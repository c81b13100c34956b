"""Depths of objects, and which depth image belongs to an image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.vision.depth import surface_depth
from head_tracking.vision.pairing import Pairing


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


def test_stamps_too_far_apart_are_no_pair_and_are_counted():
    pairs = Pairing(10)
    for i in range(5):
        assert pairs.depth(1000 * i + 500, "A") is None
        assert pairs.picture(1000 * i, "a") is None
    assert pairs.dropped == 5
    assert pairs.picture(4500, "b") == ("b", "A")
    assert pairs.dropped == 0


def test_depths_that_come_two_images_late_complete_their_pairs():
    pairs = Pairing(10)
    for i in range(2):
        assert pairs.picture(1000 * i, i) is None
    for i in range(2, 10):
        assert pairs.picture(1000 * i, i) is None
        assert pairs.depth(1000 * (i - 2), i - 2) == (i - 2, i - 2)
    assert pairs.dropped == 0


def test_images_without_any_depth_are_counted():
    pairs = Pairing(10)
    for i in range(9):
        assert pairs.picture(1000 * i, "a") is None
    assert pairs.dropped == 3


@given(st.permutations([(kind, i) for kind in ("picture", "depth") for i in range(5)]))
def test_pairs_match_and_are_in_order(order):
    pairs, found = Pairing(10), []
    for kind, i in order:
        pair = getattr(pairs, kind)(1000 * i, i)
        if pair is not None:
            found.append(pair)
    assert all(a == b for a, b in found)
    assert len({a for a, _ in found}) == len(found)
