import pytest

from head_tracking.transforms import Transform, TransformBuffer

SECOND = 1_000_000_000
STILL = Transform.identity()


@pytest.fixture
def buffer(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    for index in range(11):
        buffer.set_joint_positions(
            10 * SECOND + index * SECOND // 10, {"head_pan_joint": 0.0, "head_tilt_joint": 0.0}
        )
    return buffer


def test_the_tree_is_drawn_with_joints_rates_and_ages(buffer):
    lines = buffer.tree_as_string(now=11 * SECOND + SECOND // 2).splitlines()
    assert lines[0] == "base_link"
    assert lines[1] == "└── torso_link"
    assert lines[3].endswith("pan_tilt_bracket  [head_pan_joint] 11.0 Hz, 0.500 s old")
    assert any(line.endswith("├── hair_link") for line in lines)
    assert len(lines) == 14


def test_without_a_time_there_are_no_ages(buffer):
    assert "old" not in buffer.tree_as_string()


def test_several_trees_are_drawn_one_below_the_other(buffer):
    buffer.set_transform(SECOND, "map", "ball", STILL)
    lines = buffer.tree_as_string().splitlines()
    assert lines[-2:] == ["map", "└── ball  [transforms] 10000.0 Hz"]


def test_what_was_never_heard_of_is_said(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    assert "[head_pan_joint] nothing known" in buffer.tree_as_string()


def test_a_good_tree_has_no_problems(buffer):
    assert buffer.problems(11 * SECOND, SECOND) == []


def test_problems_are_named(buffer):
    buffer.set_transform(SECOND, "map", "ball", STILL)
    problems = buffer.problems(14 * SECOND, SECOND)
    assert problems == [
        "there are 2 trees that nothing connects: base_link, map",
        "'head_pan_joint' was last heard of 3.0 s ago",
        "'head_tilt_joint' was last heard of 3.0 s ago",
        "'ball' was last heard of 13.0 s ago",
    ]


def test_silent_joints_and_an_empty_buffer_are_problems(kinectbot):
    buffer = TransformBuffer()
    assert "no frame is known" in buffer.problems(SECOND, SECOND)[0]
    buffer.set_model(kinectbot)
    assert buffer.problems(SECOND, SECOND) == [
        "the joint 'head_pan_joint' was never heard of",
        "the joint 'head_tilt_joint' was never heard of",
    ]
