"""Laws of the table frame for any pose of the camera."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import random_rotation, transform_points
from pipelines.tabletop.levelling import table_from_camera


@given(st.integers(0, 2**31), st.floats(0.1, 2.0))
@settings(max_examples=40, deadline=None)
def test_heights_equal_those_of_the_plane_and_the_camera_is_over_the_origin(seed, distance):
    rng = np.random.default_rng(seed)
    plane = Plane(random_rotation(rng)[:, 2], distance)
    T = table_from_camera(plane)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) > 0
    points = rng.normal(size=(9, 3))
    np.testing.assert_allclose(transform_points(T, points)[:, 2], plane.height(points), atol=1e-12)
    np.testing.assert_allclose(transform_points(T, np.zeros(3)), [0, 0, distance], atol=1e-12)


def test_x_is_to_the_cameras_right_and_y_away_from_it():
    slanted = Plane(np.array([0.0, -0.8, -0.6]), 0.5)
    T = table_from_camera(slanted)
    np.testing.assert_allclose(T[:3, :3] @ [1, 0, 0], [1, 0, 0], atol=1e-12)
    assert (T[:3, :3] @ [0, 0, 1])[1] > 0
    rolled = Plane(np.array([-1.0, 0.0, 0.0]), 0.5)  # the camera's right points into the table
    np.testing.assert_allclose(table_from_camera(rolled)[:3, :3] @ [0, 1, 0], [1, 0, 0], atol=1e-12)
