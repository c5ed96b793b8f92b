"""Patches of a surface, and triangles against boxes."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.meshes import surface_patches
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.meshes.surface_patches import SurfacePatches, meet_boxes
from pipelines.geometry.transforms import make_pose, random_rotation
from tests.geometry.meshes.closest import closest_points
from tests.synthesis.naive_labels import meets

seeds = st.integers(0, 2**32 - 1)


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))


SHAPES = {
    "box of twelve triangles": mesh_of(trimesh.creation.box((0.05, 0.02, 0.08))),
    "ball of many": mesh_of(trimesh.creation.icosphere(4, 0.01)),
    "rod of slivers": mesh_of(trimesh.creation.cylinder(0.01, 0.1, sections=64)),
}


@pytest.mark.parametrize("mesh", SHAPES.values(), ids=SHAPES)
def test_every_point_of_the_surface_is_in_a_patch_that_lists_its_triangle(mesh: Mesh) -> None:
    patches = SurfacePatches.from_mesh(mesh)
    points, _, triangle = sample_surface(mesh, 300, np.random.default_rng(0))
    for point, index in zip(points, triangle, strict=True):
        around = np.linalg.norm(patches.centers - point, axis=1) <= patches.radius + 1e-12
        row, members = patches.triangles_of(np.flatnonzero(around))
        assert index in members
        assert set(row) == set(range(around.sum()))


@pytest.mark.parametrize("mesh", SHAPES.values(), ids=SHAPES)
def test_centres_lie_on_the_surface_and_patches_are_small(mesh: Mesh) -> None:
    patches = SurfacePatches.from_mesh(mesh)
    for center in patches.centers[:: 1 + len(patches) // 20]:
        feet = closest_points(mesh.triangles, np.repeat(center[None], len(mesh.faces), axis=0))
        assert np.linalg.norm(feet - center, axis=1).min() < 1e-9
    assert patches.radius.max() < 0.0065
    assert len(patches) < 2 * mesh.area / 0.004**2 + 200


def test_a_mesh_of_any_size_has_a_limited_number_of_patches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(surface_patches, "MAX_PIECES", 2000)
    sizes = np.array([0.8, 0.6, 0.4]), np.array([80.0, 60.0, 40.0])
    large, huge = (SurfacePatches.from_mesh(mesh_of(trimesh.creation.box(s))) for s in sizes)
    assert 100 < len(huge) < 2000
    assert len(large) == pytest.approx(len(huge), rel=0.1)


def test_joined_patches_keep_their_triangles() -> None:
    parts = [SurfacePatches.from_mesh(mesh) for mesh in SHAPES.values()]
    moved = parts[1].transformed(make_pose(np.eye(3), [1.0, 0.0, 0.0]))
    joined = SurfacePatches.concatenate([parts[0], moved])
    assert len(joined) == len(parts[0]) + len(parts[1])
    row, triangle = joined.triangles_of(np.array([len(parts[0]) + 5, 3]))
    _, expected = parts[1].triangles_of(np.array([5]))
    np.testing.assert_array_equal(joined.triangles[triangle[row == 0]], moved.triangles[expected])
    assert len(SurfacePatches.concatenate([])) == 0


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_overlaps_of_triangles_and_boxes_agree_with_clipping(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(60, 1, 3)) + rng.normal(size=(60, 3, 3)) * rng.uniform(0.1, 2)
    low = rng.uniform(-1.5, 0.0, (60, 3))
    high = low + rng.uniform(0.1, 1.5, (60, 3))
    expected = [meets(*row) for row in zip(triangles, low, high, strict=True)]
    assert meet_boxes(triangles, low, high).tolist() == expected


def test_touching_from_outside_is_no_overlap() -> None:
    face = np.array([[[1.0, 0, 0], [1, 1, 0], [1, 0, 1]], [[0.5, 0, 0], [0.5, 1, 0], [0.5, 0, 1]]])
    low, high = np.zeros((2, 3)), np.ones((2, 3))
    assert meet_boxes(face, low, high).tolist() == [False, True]


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_a_motion_changes_no_verdict_of_an_empty_or_full_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turned = rng.normal(size=(20, 3, 3)) @ random_rotation(rng).T
    reach = np.abs(turned).max() + 1.0
    wide = np.full((20, 3), reach)
    assert meet_boxes(turned, -wide, wide).all()
    assert not meet_boxes(turned, wide, 2 * wide).any()
