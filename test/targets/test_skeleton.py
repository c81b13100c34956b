import pytest

from head_tracking.targets import skeleton_frame

FRAMES = ("left_hand_1", "left_hand_2", "right_hand_1", "head_1", "left_hand_rest", "gripper")
STAMPS = {"left_hand_1": 5, "left_hand_2": 9, "right_hand_1": 5, "head_1": 5}


def resolve(name, **options):
    return skeleton_frame(name, FRAMES, STAMPS.__getitem__, **options)


@pytest.mark.parametrize(
    ("name", "options", "frame"),
    [
        ("left_hand", {"user": 1}, "left_hand_1"),
        ("left_hand", {"mirror": True}, "right_hand_1"),
        ("right_hand", {"mirror": True, "user": 2}, "left_hand_2"),
        ("head", {"mirror": True}, "head_1"),
        ("gripper", {"mirror": True, "user": 3}, "gripper"),
    ],
)
def test_the_frame_of_a_joint(name, options, frame):
    assert resolve(name, **options) == frame
