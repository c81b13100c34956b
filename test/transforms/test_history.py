import math
import random

import pytest

from head_tracking.transforms import JointHistory, Transform, TransformHistory

SECOND = 1_000_000_000


def test_a_position_between_two_samples_is_interpolated():
    history = JointHistory()
    history.insert(SECOND, 1.0)
    history.insert(2 * SECOND, 3.0)
    assert history.at(SECOND) == 1.0
    assert history.at(SECOND + SECOND // 4) == pytest.approx(1.5)
    assert history.at(2 * SECOND) == 3.0


def test_late_samples_find_their_place():
    samples = [(stamp * SECOND // 10, float(stamp)) for stamp in range(1, 50)]
    shuffled = samples.copy()
    random.Random(3).shuffle(shuffled)
    history = JointHistory()
    for stamp, position in shuffled:
        assert history.insert(stamp, position)
    for stamp, position in samples:
        assert history.at(stamp) == position
        if stamp < history.stamps[-1]:
            assert history.at(stamp + SECOND // 20) == pytest.approx(position + 0.5)


def test_of_two_samples_with_one_stamp_both_are_kept_as_in_tf2():
    history = JointHistory()
    for stamp, position in ((1, 0.0), (3, 1.0), (3, 2.0), (5, 4.0)):
        history.insert(stamp * SECOND, position)
    assert history.at(3 * SECOND) == 2.0
    assert history.at(2 * SECOND) == 0.5  # on the way to the one that came first
    assert history.at(4 * SECOND) == 3.0  # from the one that came last
    history.insert(3 * SECOND, 2.0)
    assert len(history) == 4


def test_ten_seconds_are_kept_and_one_sample_more():
    history = JointHistory()
    for index in range(5000):
        history.insert(index * SECOND // 100, float(index))
    assert history.stamps[-1] - history.oldest == 10 * SECOND + SECOND // 100
    assert len(history) == 1002
    assert len(history.stamps) == len(history.values) <= 2 * len(history)


def test_the_sample_before_a_pause_stays_until_the_next_one():
    history = JointHistory()
    for index in range(10):
        history.insert(index + 1, 0.0)
    history.insert(100 * SECOND, 1.0)
    assert history.at(50 * SECOND) == pytest.approx(0.5)
    history.insert(101 * SECOND, 1.0)
    assert not history.covers(50 * SECOND)


def test_a_sample_older_than_the_cache_is_not_taken():
    history = JointHistory()
    history.insert(20 * SECOND, 1.0)
    assert not history.insert(9 * SECOND, 0.0)
    assert history.stamps == [20 * SECOND]


def test_a_continuous_joint_turns_the_short_way():
    history = JointHistory(continuous=True)
    history.insert(1, 3.0)
    history.insert(3, -3.0)
    assert math.remainder(history.at(2) - math.pi, math.tau) == pytest.approx(0.0, abs=1e-12)


def test_transforms_are_interpolated_too():
    history = TransformHistory()
    history.insert(1, ("map", Transform.from_xyz_rpy((0, 0, 0), (0, 0, 0))))
    history.insert(5, ("map", Transform.from_xyz_rpy((4, 0, 0), (0, 0, 1))))
    parent, middle = history.at(2)
    assert parent == "map"
    assert middle.translation == pytest.approx((1, 0, 0))
    assert middle.rotation.as_rpy() == pytest.approx((0, 0, 0.25))
