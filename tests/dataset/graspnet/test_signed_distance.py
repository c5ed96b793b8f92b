"""Signed-distance grids as text."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.dataset.graspnet.signed_distance import as_stored, read_sdf, write_sdf
from pipelines.errors import FormatError
from pipelines.geometry.meshes.signed_distance import SignedDistanceGrid


def test_a_grid_is_written_with_x_fastest_and_read_again(tmp_path: Path) -> None:
    values = np.arange(24.0).reshape(2, 3, 4) - 5
    grid = SignedDistanceGrid(values, np.array([0.1, -0.2, 0.3]), 0.0125)
    write_sdf(tmp_path / "textured.sdf", grid)
    lines = (tmp_path / "textured.sdf").read_text().splitlines()
    assert lines[:5] == ["2 3 4", "0.1 -0.2 0.3", "0.0125", "-5", "7"]
    again = read_sdf(tmp_path / "textured.sdf")
    assert_allclose(again.values, values)
    assert_allclose(again.origin, grid.origin)
    assert again.spacing == grid.spacing


@pytest.mark.parametrize(
    "text",
    [
        "2 3",
        "2 2 2\n0 0 0\n0.1\n1 2 3\n",
        "not a grid",
        "inf 2 2\n0 0 0\n1\n1",
        "nan 0 0\n0 0 0\n1",
        "-1 -1 1\n0 0 0\n1\n5",
        "1 1 1\n0 0 0\n0\n5",
        "1 1 1\n0 0 0\n1\nnan",
    ],
)
def test_a_damaged_grid_is_reported_in_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "textured.sdf").write_text(text)
    with pytest.raises(FormatError, match=r"textured\.sdf"):
        read_sdf(tmp_path / "textured.sdf")


def test_the_stored_grid_equals_the_grid_that_is_read_again(tmp_path):
    rng = np.random.default_rng(0)
    values = rng.normal(size=(7, 8, 9)) * 10.0 ** rng.integers(-9, 1, (7, 8, 9))
    values[0, 0, :2] = 0.0, 9.9999996e-4
    grid = SignedDistanceGrid(values, rng.normal(size=3), 0.00123456789)
    write_sdf(tmp_path / "x.sdf", grid)
    again, stored = read_sdf(tmp_path / "x.sdf"), as_stored(grid)
    np.testing.assert_array_equal(stored.values, again.values)
    np.testing.assert_array_equal(stored.origin, again.origin)
    assert stored.spacing == again.spacing
