"""What is in view when the page opens."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.viewer.framing import eye

COORDINATE = st.floats(-3.0, 3.0)
POINTS = st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), min_size=2, max_size=12)


@given(POINTS, st.floats(0.4, 2.5), st.floats(0.3, 1.3))
def test_all_points_are_in_view_and_fill_it(points, aspect, field):
    points = np.unique(np.array(points).round(3), axis=0)
    if len(points) < 2 or np.ptp(points, axis=0).max() < 0.05:
        return
    found = eye(points, aspect, field, 0.9)
    ahead = np.subtract(found.look_at, found.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x, y, z = np.stack([right, np.cross(right, ahead), ahead]) @ (points - found.position).T
    assert z.min() > 0.3 - 1e-9
    height = np.tan(field / 2.0)
    x, y = x / z / (height * aspect), y / z / height
    widest = max(np.abs(x).max(), np.abs(y).max())
    assert widest == pytest.approx(0.9, abs=1e-6) or (widest < 0.9 and z.min() < 0.3 + 1e-6)


def test_a_narrow_picture_is_taken_from_farther_away():
    box = np.array([(x, y, z) for x in (0, 2) for y in (-1, 1) for z in (0, 1)], float)
    wide, narrow = (math.dist(eye(box, aspect).position, (1.0, 0.0, 0.5)) for aspect in (1.8, 0.5))
    assert narrow > 1.5 * wide
