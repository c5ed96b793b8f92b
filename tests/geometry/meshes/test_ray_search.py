"""Rays by Embree and by our own tree give the same answers, views, labels and metrics."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.geometry.meshes import ray_search
from pipelines.geometry.meshes.ray_search import EmbreeSearch, TreeSearch
from pipelines.geometry.transforms import unit
from tests.geometry.meshes import ray_answers

ROOT = Path(__file__).resolve().parents[3]
SHAPES = {
    "box": trimesh.creation.box((0.2, 0.1, 0.3)),
    "ball": trimesh.creation.icosphere(4, 0.1),
    "ring": trimesh.creation.torus(0.1, 0.02),
    "can": trimesh.creation.cylinder(0.05, 0.2),
}
NEAR_EDGES = 1e-3  # the share of rays that may differ in single precision
SEARCHES = [EmbreeSearch, TreeSearch] if ray_search.has_embree() else [TreeSearch]


def rays(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rays from all sides toward the surroundings of the origin."""
    rng = np.random.default_rng(seed)
    start = 0.5 * unit(rng.normal(size=(count, 3)))
    return start, unit(rng.normal(0.0, 0.07, (count, 3)) - start)


def naive(triangles: np.ndarray, start: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Distance (r,) to the first hit among all `triangles` (t, 3, 3); inf without a hit."""
    a, b, c = triangles.swapaxes(0, 1)
    distance = np.full(len(start), np.inf)
    for r in range(len(start)):
        with np.errstate(all="ignore"):
            M = np.stack([b - a, c - a, np.broadcast_to(-along[r], a.shape)], axis=2)
            whole = np.linalg.det(M) != 0.0
            u, v, t = np.linalg.solve(M[whole], (start[r] - a[whole])[..., None])[..., 0].T
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        distance[r] = t[hit].min(initial=np.inf)
    return distance


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.skipif(not ray_search.has_embree(), reason="there is no Embree to compare with")
def test_the_tree_answers_as_embree_does(name):
    triangles, (start, along) = np.asarray(SHAPES[name].triangles), rays(20_000)
    embree, tree = EmbreeSearch(triangles), TreeSearch(triangles)
    (theirs, rough), (ours, exact) = embree.first(start, along), tree.first(start, along)
    assert (theirs != ours).mean() < NEAR_EDGES
    same = (theirs == ours) & (ours >= 0)
    assert same.mean() > 0.2
    assert_allclose(exact[same], rough[same], atol=2e-5)
    assert (embree.any(start, along) != tree.any(start, along)).mean() < NEAR_EDGES
    assert_array_equal(tree.any(start, along), ours >= 0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
@settings(max_examples=30, deadline=None)
def test_the_tree_answers_as_trying_every_triangle_does(seed, count):
    rng = np.random.default_rng(seed)
    triangles = rng.normal(0.0, 0.1, (count, 1, 3)) + rng.normal(0.0, 0.05, (count, 3, 3))
    triangles[::7] = triangles[0]  # any of equally near triangles may be hit
    triangles[3::9, 1] = triangles[3::9, 0]  # a triangle without area
    start, along = rays(50, seed)
    found, distance = TreeSearch(triangles).first(start, along)
    assert_allclose(distance, naive(triangles, start, along), rtol=1e-9)
    assert_array_equal(found >= 0, np.isfinite(distance))


@pytest.mark.parametrize("search", SEARCHES)
def test_rays_along_axes_and_through_edges_meet_a_box(search):
    made = search(np.asarray(SHAPES["box"].triangles))
    start = np.array([[0.0, 0.0, -1.0], [0.05, 0.025, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    along = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0]], float)
    found, distance = made.first(start, along)
    assert_allclose(distance, [0.85, 0.85, 0.9, 0.95], atol=1e-6)
    assert (found >= 0).all()
    assert made.any(start, along).all()
    assert not made.any(start, -along).any()
    assert made.any(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def answers(*code: str) -> dict:
    """Return the figures of `ray_answers` from a separate process."""
    lines = "; ".join((*code, "from tests.geometry.meshes import ray_answers as r", "r.main()"))
    printed = subprocess.run(
        [sys.executable, "-c", lines],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    return json.loads(printed)


@pytest.mark.skipif(not ray_search.has_embree(), reason="there is no Embree to compare with")
def test_views_labels_and_metrics_are_the_same_without_embree():
    hidden = answers("import sys", "sys.modules['embreex'] = None")
    assert hidden.pop("embree") is False
    assert hidden == pytest.approx(ray_answers.answers(), rel=1e-6)
