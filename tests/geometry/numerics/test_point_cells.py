"""Points in cubes: each value is found once, and no cube hides a point."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.geometry.numerics.point_cells import PointCells, cell_keys, first_of_each

keys = st.lists(st.integers(0, 2**40), max_size=60) | st.lists(st.integers(0, 5), max_size=60)
seeds = st.integers(0, 2**31)


@given(keys)
def test_first_indices_equal_those_of_numpys_unique(numbers):
    key = np.array(numbers, np.int64)
    _, first = np.unique(key, return_index=True)
    assert_array_equal(first_of_each(key), np.sort(first))


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_points_share_a_key_where_they_share_a_cube(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.1, 0.1, (50, 3))
    cubes = np.floor((points - points.min(axis=0)) / 0.05)
    alike = (cubes[:, None] == cubes).all(axis=-1)
    key = cell_keys(points, 0.05)
    assert_array_equal(key[:, None] == key, alike)


@given(seeds, st.integers(0, 300))
@settings(max_examples=25, deadline=None)
def test_every_point_lies_in_the_ball_of_its_cube_and_in_one_cube(seed, count):
    points = np.random.default_rng(seed).normal(0, 0.05, (count, 3))
    cells = PointCells.of(points, 0.03)
    assert_array_equal(np.sort(cells.index), np.arange(count))
    for number in range(len(cells)):
        span = slice(cells.start[number], cells.start[number + 1])
        members = points[cells.index[span]]
        away = np.linalg.norm(members - cells.center[:, number], axis=1)
        assert len(members) > 0
        assert (away <= cells.radius[number]).all()
        assert_array_equal(cells.points[:, span], members.T.astype(np.float32))
