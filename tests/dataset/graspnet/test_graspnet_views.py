"""The view template and the rotations of grasp labels."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.dataset.graspnet.graspnet_views import (
    IN_PLANE_ANGLES,
    generate_views,
    view_rotations,
)

# Entries of the original's generate_views(300), run under NumPy 1.26.
ORIGINAL = {
    1: [-0.10401856899261475, -0.09528957307338715, -0.9900000095367432],
    150: [-0.27837154269218445, -0.9604676961898804, 0.0033333301544189453],
    298: [0.06472833454608917, 0.12534037232398987, 0.9900000095367432],
}


def naive_rotation(view: np.ndarray, angle: float) -> np.ndarray:
    """The definition, one grasp at a time."""
    x = -view / np.linalg.norm(view)
    y = np.array([-x[1], x[0], 0.0])
    y = y / np.linalg.norm(y)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([x, y, np.cross(x, y)], 1) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def test_the_template_is_float32_and_the_originals() -> None:
    views = generate_views()
    assert views.dtype == np.float32
    for index, original in ORIGINAL.items():
        assert_allclose(views[index], original, atol=2e-7)


def test_float64_views_would_differ_from_the_template() -> None:
    index = np.arange(300)
    z = (2 * index + 1) / 300 - 1
    x = np.sqrt(1 - z**2) * np.cos(2 * index * np.pi * (np.sqrt(5) - 1) / 2)
    assert np.abs(generate_views()[:, 0] - x).max() > 1e-5


def test_views_are_unit_vectors_for_any_count() -> None:
    assert_allclose(np.linalg.norm(generate_views(77), axis=1), 1.0, atol=1e-6)


def test_all_rotations_agree_with_the_definition() -> None:
    rotations, views = view_rotations(), generate_views()
    assert rotations.shape == (300, 12, 3, 3)
    for view in (0, 17, 299):
        for angle in (0, 5, 11):
            expected = naive_rotation(views[view], IN_PLANE_ANGLES[angle])
            assert_allclose(rotations[view, angle], expected, atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 299), st.floats(0.0, np.pi))
def test_rotations_are_proper_and_approach_against_the_view(view: int, angle: float) -> None:
    direction = generate_views()[view]
    R = view_rotations(np.array([angle]))[view, 0].astype(float)
    assert_allclose(R.T @ R, np.eye(3), atol=1e-5)
    assert_allclose(np.linalg.det(R), 1.0, atol=1e-5)
    assert_allclose(R[:, 0], -direction, atol=1e-6)
