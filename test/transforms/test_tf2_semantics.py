"""Where tf2 has the same notion, the buffer does what tf2 does; each test is one of its rules."""

import math

import pytest

from head_tracking.transforms import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    Rotation,
    Transform,
    TransformBuffer,
    TransformException,
)

SECOND = 1_000_000_000


@pytest.fixture
def buffer():
    return TransformBuffer()


def moved(x: float, yaw: float = 0.0) -> Transform:
    return Transform.from_xyz_rpy((x, 0, 0), (0, 0, yaw))


def x_of(found) -> float:
    return found.transform.translation[0]


def test_time_zero_is_the_latest_common_time(buffer):
    buffer.set_transform(3 * SECOND, "map", "odom", moved(1))
    buffer.set_transform(2 * SECOND, "odom", "base", moved(1))
    buffer.set_transform(1 * SECOND, "map", "odom", moved(0))
    found = buffer.lookup_transform("map", "base")
    assert found.stamp == 2 * SECOND
    assert x_of(found) == pytest.approx(1.5)
    assert buffer.get_latest_common_time("map", "base") == 2 * SECOND


def test_static_frames_do_not_count_for_the_latest_common_time(buffer):
    buffer.set_transform(0, "map", "odom", moved(5), static=True)
    buffer.set_transform(2 * SECOND, "odom", "base", moved(1))
    assert buffer.get_latest_common_time("map", "base") == 2 * SECOND
    assert buffer.get_latest_common_time("map", "odom") == 0


def test_between_samples_it_interpolates_linearly_and_by_slerp(buffer):
    buffer.set_transform(SECOND, "map", "base", moved(1, 0.0))
    buffer.set_transform(2 * SECOND, "map", "base", moved(3, 1.0))
    found = buffer.lookup_transform("map", "base", SECOND + SECOND // 4).transform
    assert found.translation == pytest.approx((1.5, 0, 0))
    assert found.rotation.as_rpy() == pytest.approx((0, 0, 0.25))


def test_nothing_is_extrapolated(buffer):
    buffer.set_transform(SECOND, "map", "base", moved(1))
    buffer.set_transform(2 * SECOND, "map", "base", moved(3))
    with pytest.raises(ExtrapolationException, match="into the future"):
        buffer.lookup_transform("map", "base", 2 * SECOND + 1)
    with pytest.raises(ExtrapolationException, match="into the past"):
        buffer.lookup_transform("map", "base", SECOND - 1)


def test_one_sample_is_known_at_its_own_time_only(buffer):
    buffer.set_transform(SECOND, "map", "base", moved(1))
    assert buffer.can_transform("map", "base", SECOND)
    assert not buffer.can_transform("map", "base", SECOND + 1)
    assert not buffer.can_transform("map", "base", SECOND - 1)


def test_samples_may_come_out_of_order(buffer):
    for stamp in (3, 1, 2):
        buffer.set_transform(stamp * SECOND, "map", "base", moved(stamp * stamp))
    assert x_of(buffer.lookup_transform("map", "base", 2 * SECOND)) == 4
    assert x_of(buffer.lookup_transform("map", "base", 2 * SECOND + SECOND // 2)) == 6.5


def test_of_repeated_samples_the_later_to_come_counts(buffer):
    buffer.set_transform(SECOND, "map", "base", moved(1))
    buffer.set_transform(2 * SECOND, "map", "base", moved(2))
    buffer.set_transform(2 * SECOND, "map", "base", moved(9))
    assert x_of(buffer.lookup_transform("map", "base")) == 9


def test_ten_seconds_are_kept_by_default(buffer):
    """And the sample before them, until the next one comes: tf2 prunes before it inserts."""
    for index in range(301):
        buffer.set_transform(index * SECOND // 10, "map", "base", moved(index))
    assert buffer.can_transform("map", "base", 20 * SECOND - SECOND // 10)
    assert not buffer.can_transform("map", "base", 20 * SECOND - SECOND // 10 - 1)


def test_another_cache_length(buffer):
    short = TransformBuffer(cache_time=2 * SECOND)
    for index in range(10):
        short.set_transform(index * SECOND, "map", "base", moved(index))
    assert short.can_transform("map", "base", 6 * SECOND)
    assert not short.can_transform("map", "base", 6 * SECOND - 1)


def test_data_older_than_the_cache_is_not_taken(buffer):
    buffer.set_transform(20 * SECOND, "map", "base", moved(1))
    buffer.set_transform(9 * SECOND, "map", "base", moved(5))
    assert not buffer.can_transform("map", "base", 9 * SECOND)
    assert not buffer.can_transform("map", "base", 15 * SECOND)


def test_a_leading_slash_is_stripped_when_set_and_refused_when_asked_for(buffer):
    buffer.set_transform(SECOND, "/map", "/base", moved(1))
    assert buffer.can_transform("map", "base")
    with pytest.raises(InvalidArgumentException):
        buffer.lookup_transform("/map", "base")
    with pytest.raises(InvalidArgumentException):
        buffer.lookup_transform("map", "/base")
    with pytest.raises(InvalidArgumentException):
        buffer.lookup_transform("", "base")


@pytest.mark.parametrize(
    ("parent", "child", "transform", "words"),
    [
        ("", "base", moved(1), "two frame names"),
        ("/", "base", moved(1), "two frame names"),
        ("map", "", moved(1), "two frame names"),
        ("map", "/", moved(1), "two frame names"),
        ("base", "base", moved(1), "own parent"),
        ("/base", "base", moved(1), "own parent"),
        ("map", "base", moved(math.nan), "not finite"),
        ("map", "base", Transform((0, 0, 0), Rotation(0, 0, math.nan, 1)), "not finite"),
        ("map", "base", Transform((0, 0, 0), Rotation(0, 0, 0, 0)), "norm 0"),
        ("map", "base", Transform((0, 0, 0), Rotation(0, 0, 0.2, 1)), "norm 1.0198"),
    ],
)
def test_senseless_samples_are_refused(buffer, parent, child, transform, words):
    with pytest.raises(InvalidArgumentException, match=words):
        buffer.set_transform(SECOND, parent, child, transform)
    assert buffer.frames() == ()


def test_a_quaternion_a_little_off_is_taken_as_in_tf2_and_normalised(buffer):
    buffer.set_transform(SECOND, "map", "base", Transform((0, 0, 0), Rotation(0, 0, 0.06, 1)))
    rotation = buffer.lookup_transform("map", "base").transform.rotation
    assert math.hypot(*rotation) == pytest.approx(1.0, abs=1e-15)


def test_a_name_that_keeps_a_slash_cannot_be_asked_for(buffer):
    buffer.set_transform(SECOND, "b", "//a", moved(1))
    for target, source in (("/a", "b"), ("b", "/a")):
        with pytest.raises(InvalidArgumentException):
            buffer.lookup_transform(target, source)
        assert not buffer.can_transform(target, source)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((0.0, 0.0, 0.6, 0.8), (0.0, 0.0, 0.6, 0.8)),
        ((0.0, 0.0, 0.6, -0.8), (0.0, 0.0, -0.6, 0.8)),
        ((0.0, 0.28, -0.96, 0.0), (0.0, -0.28, 0.96, 0.0)),
        ((-0.96, 0.0, 0.0, 0.28), (0.96, 0.0, 0.0, -0.28)),
    ],
)
def test_of_the_two_quaternions_of_a_rotation_it_is_tf2_s(buffer, given, expected):
    buffer.set_transform(SECOND, "map", "base", Transform((0.0, 0.0, 0.0), Rotation(*given)))
    assert buffer.lookup_transform("map", "base").transform.rotation == pytest.approx(expected)
    full = buffer.lookup_transform_full("map", SECOND, "base", SECOND, "map")
    assert full.transform.rotation == pytest.approx(expected)


def test_a_frame_in_itself_is_always_known_even_if_it_is_not(buffer):
    found = buffer.lookup_transform("nowhere", "nowhere", 5 * SECOND)
    assert (found.stamp, found.transform) == (5 * SECOND, Transform.identity())
    assert buffer.can_transform("nowhere", "nowhere")
    buffer.set_transform(3 * SECOND, "map", "base", moved(1))
    assert buffer.lookup_transform("base", "base").stamp == 3 * SECOND


def test_an_unknown_frame_is_a_lookup_exception(buffer):
    buffer.set_transform(SECOND, "map", "base", moved(1))
    with pytest.raises(LookupException, match="'nose' does not exist"):
        buffer.lookup_transform("map", "nose")


def test_two_trees_are_a_connectivity_exception(buffer):
    buffer.set_transform(SECOND, "map", "base", moved(1))
    buffer.set_transform(SECOND, "world", "table", moved(1))
    with pytest.raises(ConnectivityException, match="two trees"):
        buffer.lookup_transform("base", "table")
    with pytest.raises(ConnectivityException):
        buffer.lookup_transform("base", "table", SECOND)
    with pytest.raises(ConnectivityException):
        buffer.get_latest_common_time("base", "table")


def test_trees_can_be_joined_later(buffer):
    buffer.set_transform(SECOND, "map", "base", moved(1))
    buffer.set_transform(SECOND, "world", "table", moved(1))
    assert not buffer.can_transform("base", "table")
    buffer.set_transform(SECOND, "world", "map", moved(10))
    assert x_of(buffer.lookup_transform("base", "table")) == pytest.approx(-10)


def test_a_loop_is_a_lookup_exception_for_who_would_have_to_leave_it(buffer):
    buffer.set_transform(SECOND, "a", "b", moved(1))
    buffer.set_transform(SECOND, "b", "c", moved(1))
    buffer.set_transform(SECOND, "c", "a", moved(1))
    buffer.set_transform(SECOND, "world", "d", moved(1))
    assert x_of(buffer.lookup_transform("a", "c")) == 2
    with pytest.raises(LookupException, match="loop: a, c, b"):
        buffer.lookup_transform("world", "a")
    with pytest.raises(LookupException, match="loop"):
        buffer.lookup_transform("a", "world", SECOND)


def test_a_frame_that_changes_its_parent_was_where_it_was(buffer):
    buffer.set_transform(0, "world", "left", moved(-10), static=True)
    buffer.set_transform(0, "world", "right", moved(10), static=True)
    for stamp, parent in ((1, "left"), (2, "left"), (3, "right"), (4, "right")):
        buffer.set_transform(stamp * SECOND, parent, "ball", moved(stamp))
    assert x_of(buffer.lookup_transform("world", "ball")) == 14
    assert x_of(buffer.lookup_transform("world", "ball", 3 * SECOND)) == 13
    assert x_of(buffer.lookup_transform("world", "ball", SECOND + SECOND // 2)) == -8.5
    # between the last sample in one parent and the first in the other the older one holds
    assert x_of(buffer.lookup_transform("world", "ball", 2 * SECOND + SECOND // 2)) == -8


def test_a_frame_that_changed_its_parent_settles_when_the_old_samples_are_gone(buffer):
    buffer.set_transform(SECOND, "left", "ball", moved(1))
    for index in range(200):
        buffer.set_transform(2 * SECOND + index * SECOND // 10, "right", "ball", moved(2))
    with pytest.raises(ConnectivityException):
        buffer.lookup_transform("left", "ball")
    assert buffer.can_transform("right", "ball", 15 * SECOND)


def test_a_static_frame_can_begin_to_move_and_come_to_rest(buffer):
    buffer.set_transform(0, "map", "base", moved(1), static=True)
    buffer.set_transform(SECOND, "map", "base", moved(2))
    assert not buffer.can_transform("map", "base", 2 * SECOND)
    buffer.set_transform(0, "map", "base", moved(3), static=True)
    assert x_of(buffer.lookup_transform("map", "base", 99 * SECOND)) == 3


def test_static_transforms_keep_the_time_asked_for(buffer):
    buffer.set_transform(0, "map", "base", moved(1), static=True)
    assert buffer.lookup_transform("map", "base", 7 * SECOND).stamp == 7 * SECOND
    assert buffer.lookup_transform("map", "base").stamp == 0


def test_full_goes_through_a_frame_that_stands_still(buffer):
    for stamp in (1, 2, 3):
        buffer.set_transform(stamp * SECOND, "odom", "base", moved(stamp))
        buffer.set_transform(stamp * SECOND, "odom", "ball", moved(10 * stamp))
    found = buffer.lookup_transform_full("base", 3 * SECOND, "ball", SECOND, "odom")
    assert x_of(found) == pytest.approx(10 - 3)
    assert found.stamp == 3 * SECOND
    assert (found.target_frame, found.source_frame) == ("base", "ball")
    back = buffer.lookup_transform_full("base", SECOND, "base", 3 * SECOND, "odom")
    assert x_of(back) == pytest.approx(2)  # where base will be, as base sees it now
    with pytest.raises(ExtrapolationException):
        buffer.lookup_transform_full("base", 9 * SECOND, "ball", SECOND, "odom")
    with pytest.raises(LookupException, match="nose"):
        buffer.lookup_transform_full("base", SECOND, "ball", SECOND, "nose")


def test_clear_forgets_samples_but_neither_names_nor_static_frames(buffer):
    buffer.set_transform(0, "map", "odom", moved(1), static=True)
    buffer.set_transform(SECOND, "odom", "base", moved(1))
    buffer.clear()
    assert buffer.can_transform("map", "odom")
    assert "base" in buffer.frames()
    with pytest.raises(ConnectivityException):
        buffer.lookup_transform("odom", "base")
    with pytest.raises(ExtrapolationException):
        buffer.lookup_transform("odom", "base", SECOND)
    buffer.set_transform(5 * SECOND, "odom", "base", moved(4))
    assert x_of(buffer.lookup_transform("odom", "base")) == 4


def test_what_lies_above_the_common_frame_need_not_be_known_then(buffer):
    buffer.set_transform(9 * SECOND, "map", "odom", moved(1))
    for stamp in (1, 2):
        buffer.set_transform(stamp * SECOND, "odom", "base", moved(stamp))
        buffer.set_transform(stamp * SECOND, "odom", "ball", moved(stamp))
    assert buffer.can_transform("base", "ball", SECOND)
    assert not buffer.can_transform("map", "ball", SECOND)


def test_the_frames_as_tf2_writes_them(buffer):
    buffer.set_transform(0, "map", "odom", moved(1), static=True, authority="mapper")
    buffer.set_transform(SECOND, "odom", "base", moved(1))
    buffer.set_transform(2 * SECOND, "odom", "base", moved(1))
    assert buffer.all_frames_as_string() == (
        "Frame odom exists with parent map.\nFrame base exists with parent odom.\n"
    )
    assert buffer.all_frames_as_yaml(now=3 * SECOND) == (
        "odom: \n  parent: 'map'\n  broadcaster: 'mapper'\n  rate: 10000.000\n"
        "  most_recent_transform: 0.000000\n  oldest_transform: 0.000000\n"
        "  transform_delay: 3.000\n  buffer_length: 0.000\n"
        "base: \n  parent: 'odom'\n  broadcaster: 'default_authority'\n  rate: 2.000\n"
        "  most_recent_transform: 2.000000\n  oldest_transform: 1.000000\n"
        "  transform_delay: 1.000\n  buffer_length: 1.000\n"
    )
    assert TransformBuffer().all_frames_as_yaml() == "[]"


def test_all_errors_have_one_root():
    for kind in (
        LookupException,
        ConnectivityException,
        ExtrapolationException,
        InvalidArgumentException,
    ):
        assert issubclass(kind, TransformException)
