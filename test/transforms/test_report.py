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


def test_the_tree_has_a_line_for_each_frame_with_joints_rates_and_ages(buffer):
    lines = buffer.tree_as_string(now=11 * SECOND + SECOND // 2).splitlines()
    assert lines[0] == "base_link"
    assert lines[1] == "└── torso_link"
    assert "pan_tilt_bracket  [head_pan_joint] 11.0 Hz, 0.500 s" in lines[3]
    assert any(line.endswith("├── hair_link") for line in lines)
    assert len(lines) == 14
    assert "0.500" not in buffer.tree_as_string()


def test_each_tree_and_each_old_frame_is_a_problem(buffer):
    buffer.set_transform(SECOND, "map", "ball", STILL)
    trees, pan, tilt, ball = buffer.problems(14 * SECOND, SECOND)
    assert "base_link, map" in trees
    for name, age, text in (
        ("head_pan_joint", "3.0", pan),
        ("head_tilt_joint", "3.0", tilt),
        ("ball", "13.0", ball),
    ):
        assert name in text
        assert age in text


def test_joints_without_samples_and_an_empty_buffer_are_problems(kinectbot):
    buffer = TransformBuffer()
    assert len(buffer.problems(SECOND, SECOND)) == 1
    buffer.set_model(kinectbot)
    pan, tilt = buffer.problems(SECOND, SECOND)
    assert "head_pan_joint" in pan
    assert "head_tilt_joint" in tilt
