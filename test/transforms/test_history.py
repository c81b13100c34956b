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
    samples = [(stamp * SECOND // 10, float(stamp)) for stamp in range(50)]
    shuffled = samples.copy()
    random.Random(3).shuffle(shuffled)
    history = JointHistory()
    for stamp, position in shuffled:
        assert history.insert(stamp, position)
    for stamp, position in samples:
        assert history.at(stamp) == position
        if stamp < history.latest:
            assert history.at(stamp + SECOND // 20) == pytest.approx(position + 0.5)


def test_of_two_samples_with_one_stamp_the_later_to_come_is_believed_as_in_tf2():
    history = JointHistory()
    history.insert(SECOND, 1.0)
    history.insert(SECOND, 2.0)
    assert history.at(SECOND) == history.newest == 2.0
    assert len(history) == 1


def test_ten_seconds_are_kept_and_no_more_than_a_little_beyond():
    history = JointHistory()
    for index in range(5000):
        history.insert(index * SECOND // 100, float(index))
    assert history.latest - history.oldest >= 10 * SECOND
    assert len(history) < 1002
    assert history.oldest == history.latest - 10 * SECOND


def test_all_old_samples_go_after_a_pause():
    history = JointHistory()
    for index in range(10):
        history.insert(index, 0.0)
    history.insert(100 * SECOND, 1.0)
    assert len(history) == 1


def test_a_sample_older_than_the_cache_is_not_taken():
    history = JointHistory()
    history.insert(20 * SECOND, 1.0)
    assert not history.insert(9 * SECOND, 0.0)
    assert history.oldest == 20 * SECOND


def test_a_continuous_joint_turns_the_short_way():
    history = JointHistory(continuous=True)
    history.insert(0, 3.0)
    history.insert(2, -3.0)
    assert math.remainder(history.at(1) - math.pi, math.tau) == pytest.approx(0.0, abs=1e-12)


def test_transforms_are_interpolated_too():
    history = TransformHistory()
    history.insert(0, ("map", Transform.from_xyz_rpy((0, 0, 0), (0, 0, 0))))
    history.insert(4, ("map", Transform.from_xyz_rpy((4, 0, 0), (0, 0, 1))))
    parent, middle = history.at(1)
    assert parent == "map"
    assert middle.translation == pytest.approx((1, 0, 0))
    assert middle.rotation.as_rpy() == pytest.approx((0, 0, 0.25))
