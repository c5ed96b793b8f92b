"""Shape of a region: faces, level directions, and middles between ends."""

import numpy as np
import pytest

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.grasping.symmetries.region_shape import (
    FACE_ANGLE,
    FACE_TRIALS,
    face_directions,
    half_between_ends,
    halfway_up,
    largest_face,
    level_directions,
)
from tests.grasping.symmetries.views import seen_box


def test_a_candidate_plane_cuts_an_object_on_the_table_at_half_its_height():
    rng = np.random.default_rng(1)
    points = rng.uniform(-1, 1, (500, 3)) * [0.03, 0.03, 0.0] + [0, 0, 0.12]
    assert halfway_up(points, Plane(np.array([0, 0, 1.0]), 0.0))[2] == pytest.approx(0.06)


def test_a_few_flying_pixels_do_not_move_the_middle():
    points = np.zeros((1000, 3))
    points[:, 0] = np.linspace(0.0, 0.1, 1000)
    points[:5, 0] = -0.3
    assert half_between_ends(points, np.array([[1.0, 0, 0]]))[0] == pytest.approx(0.05, abs=0.001)


def test_level_directions_are_parallel_to_the_table_and_face_directions_are_orthogonal():
    rng = np.random.default_rng(2)
    points, normals = seen_box(np.array([0.05, 0.08, 0.1]), [0.5, -0.7, 0.7], rng)
    table = Plane(unit([0.1, 0.2, 1.0]), 0.05)
    for direction in level_directions(points, table):
        assert abs(float(direction @ table.normal)) < 1e-9
    face, *across = face_directions(points, normals)
    for first, second in zip(across[::2], across[1::2], strict=True):
        assert np.abs(np.stack([face, first, second]) @ np.stack([face, first, second]).T)[
            ~np.eye(3, dtype=bool)
        ].max() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("count", [1, 39, 400])
def test_the_largest_face_is_the_one_that_most_normals_are_close_to(count):
    rng = np.random.default_rng(count)
    normals = unit(rng.normal(size=(count, 3)) * [0.1, 0.3, 1.0])
    trials = normals[:: max(1, count // FACE_TRIALS)]
    cosine, narrow = np.abs(normals @ trials.T), np.cos(FACE_ANGLE)
    best = trials[np.clip((cosine - narrow) / (1.0 - narrow), 0.0, 1.0).sum(axis=0).argmax()]
    near = normals[np.abs(normals @ best) > narrow]
    expected = unit((near * np.sign(near @ best)[:, None]).sum(axis=0))
    np.testing.assert_allclose(largest_face(normals), expected, atol=1e-12)
