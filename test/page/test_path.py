"""Closed paths."""

import pytest

from head_tracking.gaze import PanTiltHead
from head_tracking.page.path import SHAPES, ClosedPath, path_ahead


def test_a_path_passes_its_points_and_returns_to_the_first():
    path = ClosedPath([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 4.0, 0.0)])
    assert path.at(3.0) == pytest.approx((3.0, 0.0, 0.0))
    assert path.at(7.0) == pytest.approx((3.0, 4.0, 0.0))
    assert path.at(9.5) == pytest.approx((1.5, 2.0, 0.0))
    assert path.at(12.0) == path.at(0.0) == (0.0, 0.0, 0.0)


@pytest.fixture
def head(robot) -> PanTiltHead:
    return PanTiltHead(
        robot, "head_pan_joint", "head_tilt_joint", "camera_link", tilt_limits=(-1.0, 1.2)
    )


def miss(robot, head: PanTiltHead, point) -> float:
    """The angle by which the head misses a point of the root when it looks there [rad]."""
    at_zero = dict.fromkeys(robot.independent_joints, 0.0)
    there = robot.transform(robot.root, head.base_frame, at_zero).inverse() @ point
    gaze = head.gaze(there, 0.0, 0.0)
    return head.miss(there, gaze.pan, gaze.tilt)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_head_can_look_along_every_path_which_has_the_requested_width(robot, head, shape):
    path = path_ahead(robot, head, shape, 0.3)
    points = [path.at(0.01 * step) for step in range(240)]  # once around at least
    for point in points[::20]:
        assert miss(robot, head, point) < 1e-3
    ys, zs = ([point[axis] for point in points] for axis in (1, 2))
    assert max(ys) - min(ys) == pytest.approx(0.6, abs=0.01)
    height = 0.3 if shape == "figure of eight" else 0.6
    assert max(zs) - min(zs) == pytest.approx(height, abs=0.01)
