import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.transforms import Rotation, Transform

angles = st.floats(-math.pi, math.pi)
vectors = st.tuples(*[st.floats(-10, 10)] * 3)
transforms = st.builds(Transform.from_xyz_rpy, vectors, vectors)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_matrix_round_trip_at_half_a_turn(axis):
    half_turn = Rotation.from_axis_angle(axis, math.pi)
    back = Rotation.from_matrix(half_turn.as_matrix())
    assert np.allclose(back.as_matrix(), half_turn.as_matrix(), atol=1e-12)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_rpy_round_trip(roll, pitch, yaw):
    back = Rotation.from_rpy(roll, pitch, yaw).as_rpy()
    assert np.allclose(
        Rotation.from_rpy(*back).as_matrix(),
        Rotation.from_rpy(roll, pitch, yaw).as_matrix(),
        atol=1e-9,
    )


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_rpy_straight_up_and_down(pitch):
    rotation = Rotation.from_rpy(0.3, pitch, 0.8)
    roll, found, yaw = rotation.as_rpy()
    assert roll == 0
    assert found == pytest.approx(pitch)
    assert np.allclose(
        Rotation.from_rpy(roll, found, yaw).as_matrix(), rotation.as_matrix(), atol=1e-7
    )


def test_rpy_turns_about_fixed_axes_in_order():
    turned = Rotation.from_rpy(math.pi / 2, 0, math.pi / 2) @ (0, 1, 0)
    assert turned == pytest.approx((0, 0, 1))


@given(transforms, transforms, vectors)
def test_composition_is_the_product_of_matrices(a, b, p):
    assert np.allclose((a @ b).as_matrix(), a.as_matrix() @ b.as_matrix(), atol=1e-9)
    assert np.allclose((a @ b) @ p, a @ (b @ p), atol=1e-9)


@given(transforms)
def test_the_inverse_undoes(a):
    assert np.allclose((a @ a.inverse()).as_matrix(), np.eye(4), atol=1e-9)
    assert np.allclose((a.inverse() @ a).as_matrix(), np.eye(4), atol=1e-9)


@given(transforms)
def test_matrix_round_trip(a):
    assert np.allclose(Transform.from_matrix(a.as_matrix()).as_matrix(), a.as_matrix(), atol=1e-9)


@pytest.mark.parametrize(
    "matrix", [np.eye(4), 2 * np.eye(3), -np.eye(3), np.zeros((3, 3)), np.full((3, 3), np.nan)]
)
def test_a_matrix_that_does_not_rotate_is_refused(matrix):
    with pytest.raises(ValueError, match="rotation"):
        Rotation.from_matrix(matrix)


def test_a_transform_is_a_homogeneous_matrix():
    with pytest.raises(ValueError, match="shape"):
        Transform.from_matrix(np.eye(3))
    mirrored = np.diag((1.0, 1.0, -1.0, 1.0))
    with pytest.raises(ValueError, match="rotation"):
        Transform.from_matrix(mirrored)
