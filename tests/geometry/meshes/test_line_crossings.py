"""Crossings of lines and meshes."""

import numpy as np
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry.meshes.line_crossings import line_crossings
from pipelines.geometry.meshes.mesh import Mesh
from tests.synthesis.naive_labels import line_hits

GRAZE = 1e-5  # of a triangle's sides; rays are cast in single precision


def shells() -> Mesh:
    """A ball in a thick-walled box: six surfaces on a line through all."""
    outer, inner = trimesh.creation.box((0.1,) * 3), trimesh.creation.box((0.08,) * 3)
    inner.invert()
    made = trimesh.util.concatenate([outer, inner, trimesh.creation.icosphere(2, 0.02)])
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def test_a_line_meets_every_surface_in_order() -> None:
    start, along = np.array([[-0.1, 0.001, 0.0023]]), np.array([[1.0, 0.0, 0.0]])
    crossings = line_crossings(shells(), start, along, 1.0)
    assert crossings.count.tolist() == [6]
    assert crossings.leave[0].tolist() == [False, True, False, True, False, True]
    assert_allclose(crossings.distance[0, [0, 1, 4, 5]], [0.05, 0.06, 0.14, 0.15], atol=1e-9)
    near = line_crossings(shells(), start, along, 0.1)
    assert near.count.tolist() == [3]


def test_a_wall_of_a_hundredth_of_a_millimetre_has_two_sides() -> None:
    made = trimesh.creation.box((0.1, 0.1, 1e-5))
    mesh = Mesh(np.asarray(made.vertices), np.asarray(made.faces))
    start, along = np.array([[0.013, 0.007, -0.05]]), np.array([[0.0, 0.0, 1.0]])
    assert line_crossings(mesh, start, along, 1.0).leave.tolist() == [[False, True]]


def test_no_lines_and_no_crossings_are_empty() -> None:
    assert len(line_crossings(shells(), np.zeros((0, 3)), np.zeros((0, 3)), 1.0).count) == 0
    away = line_crossings(shells(), np.array([[1.0, 0, 0]]), np.array([[1.0, 0, 0]]), 1.0)
    assert away.count.tolist() == [0]


def grazes(triangles: np.ndarray, start: np.ndarray, along: np.ndarray) -> bool:
    """Return whether a line passes an edge too closely for single precision to decide."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    sides = np.stack([first, second, np.broadcast_to(-along, first.shape)], -1)
    u, v, _ = np.linalg.solve(sides, (start - triangles[:, 0])[..., None])[..., 0].T
    return bool((np.abs([u, v, 1 - u - v]) < GRAZE).any())


@given(st.integers(0, 2**32 - 1))
@example(206770)  # one of its lines passes an edge at 1e-7 of the triangle's size
@settings(max_examples=20, deadline=None)
def test_crossings_of_a_triangle_soup_are_those_of_its_triangles_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(30, 1, 3)) * 0.05 + rng.normal(size=(30, 3, 3)) * 0.05
    mesh = Mesh(triangles.reshape(-1, 3), np.arange(90).reshape(-1, 3))
    start = rng.normal(size=(20, 3)) * 0.05
    along = rng.normal(size=(20, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    crossings = line_crossings(mesh, start, along, 0.1)
    clear = [i for i in range(20) if not grazes(triangles, start[i], along[i])]
    assert len(clear) > 10
    for i in clear:
        distance, cosine = line_hits(triangles, start[i], along[i])
        kept = (distance >= 0) & (distance <= 0.1)
        order = np.argsort(distance[kept])
        found = slice(0, crossings.count[i])
        assert_allclose(crossings.distance[i, found], distance[kept][order], atol=1e-9)
        assert_allclose(crossings.cosine[i, found], cosine[kept][order], atol=1e-9)
