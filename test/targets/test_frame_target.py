import pytest

from head_tracking.targets import FrameTarget, FrameTargetParameters, StaleFrameError
from head_tracking.transforms import (
    LookupException,
    Rotation,
    Transform,
    TransformBuffer,
    TransformException,
)

SECOND = 1_000_000_000


@pytest.fixture
def buffer(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    return buffer


def see(buffer, frame, stamp, x, parent="base_link"):
    turned = Rotation.from_rpy(0.0, 0.0, 1.5707963267948966)
    buffer.set_transform(stamp, parent, frame, Transform((x, 0.0, 1.0), turned))


def target(buffer, frame, **options):
    return FrameTarget(buffer, FrameTargetParameters(frame=frame, **options))


def test_a_frame_of_another_program_keeps_its_own_stamp(buffer):
    see(buffer, "ball", 3 * SECOND, 2.0)
    found = target(buffer, "ball", offset=(0.5, 0.0, 0.0)).newest(3 * SECOND + 1000)
    assert (found.stamp, found.frame_id) == (3 * SECOND, "base_link")
    assert found.point == pytest.approx((2.0, 0.5, 1.0))


@pytest.mark.parametrize("later", [600_000_000, -8 * SECOND])
def test_silence_when_nobody_sees_it_any_more_or_it_lies_in_the_future(buffer, later):
    see(buffer, "ball", 9 * SECOND, 2.0)
    with pytest.raises(StaleFrameError):
        target(buffer, "ball").newest(9 * SECOND + later)


def test_a_link_that_never_moves_is_always_fresh(buffer):
    torso = target(buffer, "torso_link")
    for now in (5 * SECOND, 6 * SECOND):
        assert torso.newest(now).stamp == now


@pytest.mark.parametrize(
    ("frame", "options", "x"),
    [
        ("left_hand", {}, 2.0),
        ("left_hand", {"skeleton_user": 1}, 1.0),
        ("left_hand", {"mirror_skeleton": True}, 3.0),
        ("right_hand", {"mirror_skeleton": True, "skeleton_user": 1}, 1.0),
        ("head", {"mirror_skeleton": True}, 4.0),
        ("gripper", {"mirror_skeleton": True, "skeleton_user": 3}, 5.0),  # no joint of one
    ],
)
def test_a_joint_of_a_skeleton_is_that_of_the_newest_or_the_chosen_user(buffer, frame, options, x):
    for name, second, away in (
        ("left_hand_1", 1, 1.0),
        ("left_hand_2", 2, 2.0),
        ("left_hand_rest", 2, 9.0),
        ("right_hand_2", 2, 3.0),
        ("head_1", 2, 4.0),
        ("gripper", 2, 5.0),
    ):
        see(buffer, name, second * SECOND, away)
    found = target(buffer, frame, max_age=5.0, **options).newest(2 * SECOND)
    assert found.point[0] == pytest.approx(x)


def test_an_unknown_frame_and_no_frame_are_errors(buffer):
    with pytest.raises(LookupException):
        target(buffer, "gripper").newest(SECOND)
    with pytest.raises(TransformException):
        target(buffer, "").newest(SECOND)
