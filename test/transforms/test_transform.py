import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.transforms import Rotation, Transform

numbers = st.floats(-10, 10)
vectors = st.tuples(numbers, numbers, numbers)
transforms = st.builds(Transform.from_xyz_rpy, vectors, vectors)


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


@given(transforms, transforms)
def test_interpolation_ends_and_middle(a, b):
    assert np.allclose(a.interpolate(b, 0.0).as_matrix(), a.as_matrix(), atol=1e-9)
    assert np.allclose(a.interpolate(b, 1.0).as_matrix(), b.as_matrix(), atol=1e-9)
    middle = np.array(a.interpolate(b, 0.5).translation)
    assert np.allclose(middle, (np.array(a.translation) + np.array(b.translation)) / 2)


def test_a_transform_takes_points_from_source_to_target():
    T_base_camera = Transform((0.0, 0.0, 1.0), Rotation.from_rpy(0, 0, np.pi / 2))
    assert np.allclose(T_base_camera @ (1, 0, 0), (0, 1, 1))
