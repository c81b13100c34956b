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


@pytest.mark.parametrize("shape", SHAPES)
def test_the_head_can_look_along_every_path_which_has_the_requested_width(robot, shape):
    limits = (-1.0, 1.2)
    head = PanTiltHead(
        robot, "head_pan_joint", "head_tilt_joint", "camera_link", tilt_limits=limits
    )
    to_base = robot.transform(head.base_frame, robot.root, {})
    path = path_ahead(robot, head, shape, 0.3)
    points = [path.at(0.01 * step) for step in range(240)]  # once around at least
    for point in points[::20]:
        gaze = head.gaze(to_base @ point, 0.0, 0.0)
        assert head.miss(to_base @ point, gaze.pan, gaze.tilt) < 1e-3
    ys, zs = ([point[axis] for point in points] for axis in (1, 2))
    assert max(ys) - min(ys) == pytest.approx(0.6, abs=0.01)
    height = 0.3 if shape == "figure of eight" else 0.6
    assert max(zs) - min(zs) == pytest.approx(height, abs=0.01)
