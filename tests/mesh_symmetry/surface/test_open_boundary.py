"""Rims of surfaces: found where a surface ends, and nowhere else."""

import numpy as np
import pytest

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.mesh_symmetry.surface.open_boundary import OpenBoundary, cut_off
from tests.geometry.symmetric_shapes import ball, box, cylinder


def without_top(mesh):
    return mesh.submesh(mesh.face_normals[:, 2] < 0.9)


def unwelded(mesh):
    return Mesh(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))


def with_split_face(mesh):
    """The mesh with its first triangle cut in two, so that its neighbour has a T-junction."""
    a, b, c = mesh.faces[0]
    middle = mesh.vertices[[a, b]].mean(axis=0)
    new = len(mesh.vertices)
    faces = np.concatenate([mesh.faces[1:], [[a, new, c], [new, b, c]]])
    return Mesh(np.concatenate([mesh.vertices, [middle]]), faces)


def doubled(mesh):
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1], mesh.faces[:3]]))


@pytest.mark.parametrize("spoil", [lambda mesh: mesh, unwelded, with_split_face, doubled])
@pytest.mark.parametrize("shape", [box, cylinder, ball])
def test_a_closed_surface_has_no_rim_for_any_tessellation(shape, spoil):
    assert len(OpenBoundary.of(spoil(shape())).points) == 0


@pytest.mark.parametrize("spoil", [lambda mesh: mesh, unwelded, doubled])
def test_a_box_without_its_top_ends_at_the_four_upper_edges(spoil):
    rim = OpenBoundary.of(spoil(without_top(box(0.12, 0.08, 0.05))))
    np.testing.assert_allclose(rim.points[:, 2], 0.025, atol=1e-9)
    np.testing.assert_allclose(np.ptp(rim.points[:, :2], axis=0), [0.12, 0.08], atol=1e-3)
    np.testing.assert_allclose(rim.outward, np.tile([0.0, 0.0, 1.0], (len(rim.points), 1)))


def test_points_near_the_rim_are_those_within_reach():
    rim = OpenBoundary.of(without_top(box(0.12, 0.08, 0.05)))
    points = np.array([[0.06, 0.0, 0.03], [0.0, 0.0, 0.025], [0.06, 0.0, 0.0]])
    assert np.isfinite(rim.distances(points, 0.01)).tolist() == [True, False, False]
    assert np.isinf(OpenBoundary.of(box()).distances(points, 1.0)).all()


def test_a_dent_next_to_a_hole_is_not_cut_off_with_it():
    links = np.array([(i, i + s) for i in range(12) for s in (-1, 1) if 0 <= i + s < 12])
    in_hole, in_dent = (np.isin(np.arange(12), some) for some in ([3, 4, 5], [6, 7, 8, 9]))
    at_rim = np.isin(np.arange(12), [2, 3, 5])
    np.testing.assert_array_equal(cut_off(in_hole | in_dent, at_rim, in_hole, links), in_hole)


def test_a_patch_is_cut_off_when_its_border_is_at_a_rim_and_not_otherwise():
    # Ten samples in a row; those in the middle miss.
    links = np.array([(i, i + s) for i in range(10) for s in (-1, 1) if 0 <= i + s < 10])
    missed = np.isin(np.arange(10), [3, 4, 5])
    at_rim = np.isin(np.arange(10), [2, 6])
    np.testing.assert_array_equal(cut_off(missed, at_rim, missed, links), missed)
    assert not cut_off(missed, np.zeros(10, bool), missed, links).any()
    assert not cut_off(np.ones(10, bool), at_rim, missed, links).any()
