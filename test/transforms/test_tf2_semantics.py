"""Where tf2 has the same notion, the buffer does what tf2 does; each test is one of its rules."""

import math

import pytest

from head_tracking.transforms import (
    InvalidArgumentException,
    Rotation,
    Transform,
    TransformBuffer,
)

SECOND = 1_000_000_000


@pytest.fixture
def buffer():
    return TransformBuffer()


def moved(x: float) -> Transform:
    return Transform.from_xyz_rpy((x, 0, 0))


def test_a_leading_slash_is_stripped_when_set_and_refused_when_asked_for(buffer):
    buffer.set_transform(SECOND, "/map", "/base", moved(1))
    assert buffer.can_transform("map", "base")
    for frames in (("/map", "base"), ("map", "/base"), ("", "base")):
        with pytest.raises(InvalidArgumentException):
            buffer.lookup_transform(*frames)


@pytest.mark.parametrize(
    ("parent", "child", "transform"),
    [
        ("", "base", moved(1)),
        ("/", "base", moved(1)),
        ("map", "", moved(1)),
        ("base", "base", moved(1)),
        ("map", "base", moved(math.nan)),
        ("map", "base", Transform((0, 0, 0), Rotation(0, 0, math.nan, 1))),
        ("map", "base", Transform((0, 0, 0), Rotation(0, 0, 0, 0))),
        ("map", "base", Transform((0, 0, 0), Rotation(0, 0, 0.2, 1))),
    ],
)
def test_senseless_samples_are_refused(buffer, parent, child, transform):
    with pytest.raises(InvalidArgumentException):
        buffer.set_transform(SECOND, parent, child, transform)
    assert buffer.frames() == ()


def test_a_quaternion_a_little_off_is_taken_as_in_tf2_and_normalised(buffer):
    buffer.set_transform(SECOND, "map", "base", Transform((0, 0, 0), Rotation(0, 0, 0.06, 1)))
    rotation = buffer.lookup_transform("map", "base").transform.rotation
    assert math.hypot(*rotation) == pytest.approx(1.0, abs=1e-15)


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
