"""Directions on the spiral are unit vectors, evenly spread over the sphere or its upper half."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from pipelines.geometry.directions import half_sphere_directions, sphere_directions


@pytest.mark.parametrize(
    ("directions", "area"), [(sphere_directions, 4.0), (half_sphere_directions, 2.0)]
)
@pytest.mark.parametrize("count", [100, 2000])
def test_directions_are_unit_vectors_about_equally_far_from_the_nearest(directions, area, count):
    found = directions(count)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    gap = KDTree(found).query(found, k=2)[0][:, 1] / np.sqrt(area * np.pi / count)
    assert gap.min() > 0.5
    assert gap.max() < 1.1


def test_the_whole_sphere_is_covered_evenly_and_the_half_sphere_has_no_lower_half():
    np.testing.assert_allclose(sphere_directions(500).mean(axis=0), 0.0, atol=0.01)
    assert half_sphere_directions(500)[:, 2].min() > 0.0
