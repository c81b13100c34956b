from hypothesis import given
from hypothesis import strategies as st

from head_tracking.vision.pairing import Pairing


def test_either_can_come_first():
    pairs = Pairing(10)
    assert pairs.picture(1000, "a") is None
    assert pairs.depth(1005, "A") == ("a", "A")
    assert pairs.depth(2000, "B") is None
    assert pairs.picture(1995, "b") == ("b", "B")


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
