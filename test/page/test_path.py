"""Ways that go round and round."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.page.path import SHAPES, Path, shaped

COORDINATE = st.floats(-2.0, 2.0)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)
MIDDLE, RIGHT, UP = (1.0, 0.0, 0.5), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)


@given(st.lists(POINT, min_size=2, max_size=8), st.floats(0.0, 20.0), st.floats(0.0, 1.0))
def test_along_a_path_nobody_is_faster_than_the_distance(points, start, step):
    try:
        path = Path(points)
    except ValueError:
        assert len(set(points)) == 1 or math.dist(points[0], points[1]) < 1e-6
        return
    here, there = path.at(start), path.at(start + step)
    assert math.dist(here, there) <= step + 1e-9
    again = path.at(start + path.length)
    assert again == pytest.approx(here, abs=1e-6)


def test_a_path_passes_its_points_and_goes_back_to_the_first():
    path = Path([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 4.0, 0.0)])
    assert path.length == pytest.approx(12.0)
    assert path.at(3.0) == pytest.approx((3.0, 0.0, 0.0))
    assert path.at(7.0) == pytest.approx((3.0, 4.0, 0.0))
    assert path.at(9.5) == pytest.approx((1.5, 2.0, 0.0))


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_lie_before_the_camera_and_are_as_wide_as_wanted(shape):
    path = shaped(shape, MIDDLE, RIGHT, UP, 0.3)
    points = [path.at(path.length * share / 500) for share in range(500)]
    xs, ys, zs = zip(*points, strict=True)
    assert set(xs) == {1.0}
    assert max(ys) == pytest.approx(0.3, abs=0.01)
    assert min(ys) == pytest.approx(-0.3, abs=0.01)
    assert max(zs) - 0.5 == pytest.approx(0.15 if shape == "figure of eight" else 0.3, abs=0.01)


@pytest.mark.parametrize(
    ("points", "said"), [([(0, 0, 0)], "two points"), ([(1, 0, 0)] * 3, "the same"), ([], "two")]
)
def test_what_is_no_path_says_what_to_do(points, said):
    with pytest.raises(ValueError, match=said):
        Path(points)
