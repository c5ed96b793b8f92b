"""Detection on imperfect meshes: noisy, holed, open, scaled, badly tessellated."""

import functools

import numpy as np
import pytest
import trimesh

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import make_pose, random_rotation
from tests.geometry.symmetric_shapes import ball, box, cylinder, l_shape, mesh_of
from tests.mesh_symmetry.detection.test_symmetry_detection import (
    angle_deg,
    assert_same_symmetries,
    axes_of,
    detect,
    planes_of,
)

NOISE = 0.004  # of the bounding box's diagonal
HOLE_SHARE = 0.12  # of the area


def fine(mesh, edge=0.006):
    """The same surface with triangles whose sides are at most `edge` metres."""
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, edge)
    made = trimesh.Trimesh(vertices, faces, process=False)
    made.merge_vertices()
    return mesh_of(made)


def noisy(mesh, seed=0):
    mesh = fine(mesh)
    shift = np.random.default_rng(seed).normal(size=mesh.vertices.shape) * NOISE * mesh.diagonal
    return Mesh(mesh.vertices + shift, mesh.faces)


def holed(mesh, seed=0):
    """The mesh without the faces around a random place, a tenth of its area."""
    mesh = fine(mesh)
    centers = mesh.triangles.mean(axis=1)
    place = np.random.default_rng(seed).integers(len(centers))
    order = np.argsort(np.linalg.norm(centers - centers[place], axis=1))
    kept = np.cumsum(mesh.face_areas[order]) > HOLE_SHARE * mesh.area
    return mesh.submesh(order[kept])


def without_bottom(mesh):
    return mesh.submesh(mesh.face_normals[:, 2] > -0.9)


def propeller(blades=3):
    """Tilted blades around an upright hub: a turn of 360 / blades degrees and no mirror."""
    parts = [trimesh.creation.cylinder(0.012, 0.03, sections=48)]
    for index in range(blades):
        blade = trimesh.creation.box((0.05, 0.016, 0.004))
        tilt = trimesh.transformations.rotation_matrix(0.6, (1.0, 0.0, 0.0))
        tilt[:3, 3] = (0.034, 0.0, 0.006)
        around = trimesh.transformations.rotation_matrix(2 * np.pi * index / blades, (0, 0, 1))
        parts.append(blade.apply_transform(around @ tilt))
    return mesh_of(trimesh.util.concatenate(parts))


def unwelded(mesh):
    return Mesh(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))


def half_flipped(mesh):
    faces = mesh.faces.copy()
    faces[::2] = faces[::2, ::-1]
    return Mesh(mesh.vertices, faces)


def doubled(mesh):
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[::-1, ::-1]]))


@functools.cache
def plain(shape):
    """The symmetries of a shape without defects."""
    return detect(shape())


@pytest.mark.parametrize("spoiled", [noisy, holed])
def test_planes_and_axes_are_found_despite_noise_and_holes(spoiled):
    planes = planes_of(detect(spoiled(box())))
    assert len(planes) == 3
    for plane in planes:
        assert angle_deg(plane.normal, np.eye(3)[np.abs(plane.normal).argmax()]) < 1.5
    (axis,) = axes_of(detect(spoiled(cylinder())))
    assert axis.order is None
    assert angle_deg(axis.axis, [0, 0, 1]) < 1.5
    assert detect(spoiled(ball()))[0].kind == "sphere"


@pytest.mark.parametrize("spoiled", [noisy, holed])
def test_noise_and_holes_add_no_symmetries_to_an_l(spoiled):
    found = detect(spoiled(l_shape()))
    (plane,) = planes_of(found)
    assert angle_deg(plane.normal, [0, 0, 1]) < 1.5
    assert axes_of(found) == []


def test_a_box_without_its_bottom_keeps_its_upright_planes():
    normals = np.abs([plane.normal for plane in planes_of(detect(without_bottom(fine(box()))))])
    assert normals[:, :2].max(axis=0).min() > 0.9999


def test_a_handle_is_not_excused_like_a_hole():
    # The body alone is round; a hole elsewhere does not excuse the misses of the handle.
    handle = trimesh.creation.box((0.03, 0.012, 0.05))
    handle.apply_translation((0.04, 0.0, 0.0))
    body = trimesh.creation.cylinder(0.03, 0.1, sections=64)
    found = detect(without_bottom(fine(mesh_of(trimesh.util.concatenate([body, handle])))))
    assert all(axis.order is not None for axis in axes_of(found))
    assert any(angle_deg(plane.normal, [0, 1, 0]) < 0.5 for plane in planes_of(found))


@pytest.mark.parametrize("blades", [2, 3])
def test_a_propeller_has_an_axis_but_no_mirror_plane(blades):
    (axis,) = detect(propeller(blades))
    assert isinstance(axis, RotationSymmetry)
    assert axis.order == blades
    assert angle_deg(axis.axis, [0, 0, 1]) < 1.0


@pytest.mark.parametrize("other", [unwelded, half_flipped, doubled])
@pytest.mark.parametrize("shape", [cylinder, l_shape])
def test_the_storage_of_faces_does_not_change_symmetries(shape, other):
    mesh = shape()
    assert_same_symmetries(detect(other(mesh)), plain(shape), mesh.diagonal)


@pytest.mark.parametrize(("shape", "scale"), [(box, 0.5), (cylinder, 2.0)])
def test_symmetries_scale_and_move_with_the_mesh(shape, scale):
    rng = np.random.default_rng(4)
    mesh, T = shape(), make_pose(random_rotation(rng), rng.normal(size=3))
    moved = Mesh(scale * mesh.vertices, mesh.faces).transformed(T)
    expected = [_scaled(symmetry, scale).transformed(T) for symmetry in plain(shape)]
    assert_same_symmetries(detect(moved), expected, moved.diagonal)


def _scaled(symmetry, scale):
    kind = type(symmetry)
    if kind is ReflectionSymmetry:
        return kind(symmetry.normal, scale * symmetry.point)
    return kind(symmetry.axis, scale * symmetry.point, symmetry.order)
