import pytest

from head_tracking.gaze import PanTiltHead
from head_tracking.page.gaze_lines import path_ahead, reachable_field


@pytest.fixture
def head(robot) -> PanTiltHead:
    return PanTiltHead(
        robot, "head_pan_joint", "head_tilt_joint", "camera_link", tilt_limits=(-1.0, 1.2)
    )


def miss(robot, head: PanTiltHead, point) -> float:
    """By how much the head misses a point of the root [rad], when it looks there."""
    standing = dict.fromkeys(robot.independent_joints, 0.0)
    there = robot.transform(robot.root, head.base_frame, standing).inverse() @ point
    gaze = head.gaze(there, 0.0, 0.0)
    return head.miss(there, gaze.pan, gaze.tilt)


def test_the_head_can_look_at_every_point_of_its_field(robot, head):
    for point in reachable_field(robot, head, 1.0).reshape(-1, 3)[::7]:
        assert miss(robot, head, tuple(point.tolist())) < 1e-3


@pytest.mark.parametrize("shape", ["circle", "square", "figure of eight"])
def test_the_head_can_look_along_every_path(robot, head, shape):
    path = path_ahead(robot, head, shape, 0.3)
    for point in path.points[::6]:
        assert miss(robot, head, point) < 1e-3


def test_a_shape_that_is_not_known_is_refused(robot, head):
    with pytest.raises(KeyError):
        path_ahead(robot, head, "spiral", 0.3)
