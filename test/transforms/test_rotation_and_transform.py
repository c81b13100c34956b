"""Conversions of rotations; how transforms combine is compared in test_robot_model.py."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.transforms import Rotation, Transform

angles = st.floats(-math.pi, math.pi)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_matrix_round_trip_at_half_a_turn(axis):
    half_turn = Rotation.from_axis_angle(axis, math.pi)
    back = Rotation.from_matrix(half_turn.as_matrix())
    assert np.allclose(back.as_matrix(), half_turn.as_matrix(), atol=1e-12)


@given(
    angles, st.one_of(st.floats(-1.5, 1.5), st.sampled_from([-math.pi / 2, math.pi / 2])), angles
)
def test_rotations_combine_as_matrices_and_rpy_and_matrix_round_trip(roll, pitch, yaw):
    there = Transform.from_xyz_rpy((1, 2, 3), (roll, pitch, yaw))
    turn, other = there.rotation, Rotation.from_rpy(0.3, -0.7, 1.1)
    assert np.allclose((turn @ other).as_matrix(), turn.as_matrix() @ other.as_matrix())
    assert np.allclose(turn.inverse().as_matrix(), turn.as_matrix().T)
    found = turn.as_rpy()
    assert found[0] == 0 or abs(pitch) <= 1.5
    assert found[1] == pytest.approx(pitch)
    back = Transform.from_xyz_rpy((1, 2, 3), found), Transform.from_matrix(there.as_matrix())
    exact = 1e-9 if abs(pitch) <= 1.5 else 1e-7
    assert np.allclose([each.as_matrix() for each in back], there.as_matrix(), atol=exact)


@pytest.mark.parametrize(
    "matrix", [np.eye(4), 2 * np.eye(3), -np.eye(3), np.zeros((3, 3)), np.full((3, 3), np.nan)]
)
def test_a_matrix_that_does_not_rotate_is_refused(matrix):
    with pytest.raises(ValueError, match="rotation"):
        Rotation.from_matrix(matrix)


@pytest.mark.parametrize("matrix", [np.eye(3), np.diag((1.0, 1.0, -1.0, 1.0))])
def test_a_transform_is_a_homogeneous_matrix(matrix):
    with pytest.raises(ValueError):
        Transform.from_matrix(matrix)
