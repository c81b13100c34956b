import numpy as np
import pytest

from head_tracking.gaze import PanTiltHead
from head_tracking.viewer.gaze_scene import reachable_field, with_axis_forward


@pytest.fixture
def head(robot) -> PanTiltHead:
    return PanTiltHead(
        robot, "head_pan_joint", "head_tilt_joint", "camera_link", tilt_limits=(-1.0, 1.2)
    )


def test_the_head_can_look_at_every_point_of_its_field(robot, head):
    for point in reachable_field(robot, head, 1.0).reshape(-1, 3)[::7]:
        assert head.miss(point.tolist(), *head_at(head, point)) < 1e-3


def head_at(head: PanTiltHead, point) -> tuple[float, float]:
    gaze = head.gaze(point.tolist(), 0.0, 0.0)
    return gaze.pan, gaze.tilt


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -1, 0), (0.6, 0, 0.8), (0, 0, 1), (0, 0, -1)])
def test_a_camera_is_turned_to_look_along_its_axis(axis):
    turned = with_axis_forward(axis)
    assert turned @ (0.0, 0.0, 1.0) == pytest.approx(axis)
    if abs(axis[2]) < 0.99:
        right, down = turned @ (1.0, 0.0, 0.0), turned @ (0.0, 1.0, 0.0)
        assert right[2] == pytest.approx(0.0)
        assert down[2] < 0
    assert np.linalg.det(turned.as_matrix()) == pytest.approx(1.0)
