import pytest

from head_tracking.targets import SKELETON_JOINTS, skeleton_frame

FRAMES = ("left_hand_1", "left_hand_2", "right_hand_1", "head_1", "left_hand_rest", "gripper")
STAMPS = {"left_hand_1": 5, "left_hand_2": 9, "right_hand_1": 5, "head_1": 5}


def resolve(name, **options):
    return skeleton_frame(name, FRAMES, STAMPS.__getitem__, **options)


def test_there_are_fifteen_joints_of_which_three_have_no_side():
    assert len(set(SKELETON_JOINTS)) == 15
    assert [joint for joint in SKELETON_JOINTS if "_" not in joint] == ["head", "neck", "torso"]


@pytest.mark.parametrize(
    ("name", "options", "frame"),
    [
        ("left_hand", {}, "left_hand_2"),
        ("left_hand", {"user": 1}, "left_hand_1"),
        ("left_hand", {"mirror": True}, "right_hand_1"),
        ("right_hand", {"mirror": True, "user": 2}, "left_hand_2"),
        ("head", {"mirror": True}, "head_1"),
        ("gripper", {"mirror": True, "user": 3}, "gripper"),
        ("left_foot", {}, "left_foot"),
    ],
)
def test_the_frame_of_a_joint(name, options, frame):
    assert resolve(name, **options) == frame


def test_a_frame_of_exactly_that_name_counts_too():
    frames = ("left_hand", "left_hand_1")
    assert skeleton_frame("left_hand", frames, {"left_hand": 2, "left_hand_1": 1}.get) == frames[0]
