"""Any mesh of one surface gives the same canonical mesh and the same symmetries."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.geometry.transforms import random_rotation
from pipelines.mesh_symmetry.detection.symmetry_detection import detect_symmetries
from pipelines.mesh_symmetry.surface.canonical_pose import CanonicalPose

CONFIG = AnnotateSymmetryConfig()


def dented_box() -> Mesh:
    """A box with three planes up to dents like those of a scan: no plane is exact."""
    made = trimesh.creation.box((0.1, 0.07, 0.04)).subdivide().subdivide().subdivide().subdivide()
    rng = np.random.default_rng(5)
    vertices = made.vertices + rng.normal(size=made.vertices.shape) * 0.0004
    return Mesh(vertices, np.asarray(made.faces))


def given_otherwise(mesh: Mesh, seed: int) -> tuple[Mesh, np.ndarray, np.ndarray, float]:
    """Return the same surface moved, scaled, shuffled, half of it flipped and a third doubled."""
    rng = np.random.default_rng(seed)
    rotation, scale, shift = random_rotation(rng), rng.uniform(0.5, 2.0), rng.normal(size=3)
    order = rng.permutation(len(mesh.vertices))
    vertices = (mesh.vertices @ rotation.T * scale + shift)[order]
    faces = np.argsort(order)[mesh.faces]
    faces = np.roll(faces, 1, axis=1)[rng.permutation(len(faces))]
    faces = np.where((rng.random(len(faces)) < 0.5)[:, None], faces[:, ::-1], faces)
    faces = np.concatenate([faces, faces[: len(faces) // 3]])
    return Mesh(vertices, faces), rotation, shift, scale


@pytest.mark.parametrize(
    "symmetry",
    [
        ReflectionSymmetry([0.6, 0.0, 0.8], [1.0, 2.0, 3.0], 0.01),
        RotationSymmetry([0.6, 0.0, 0.8], [1.0, 2.0, 3.0], 5, 0.01),
        SphereSymmetry([1.0, 2.0, 3.0], 0.01),
    ],
)
def test_a_symmetry_survives_the_way_to_the_canonical_pose_and_back(symmetry):
    pose = CanonicalPose.of(given_otherwise(dented_box(), 1)[0])
    back = pose.given(pose.posed(symmetry))
    assert back.kind == symmetry.kind
    assert_allclose(back.point, symmetry.point)
    assert_allclose(back.direction, symmetry.direction, atol=1e-12)
    assert not np.allclose(pose.posed(symmetry).point, symmetry.point)


@pytest.mark.parametrize("seed", range(3))
def test_the_canonical_mesh_does_not_depend_on_pose_scale_and_order_of_the_given_mesh(seed):
    mesh = dented_box()
    first, second = CanonicalPose.of(mesh), CanonicalPose.of(given_otherwise(mesh, seed)[0])
    assert_allclose(first.mesh.triangles, second.mesh.triangles, atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_symmetries_move_with_the_surface_to_a_hundredth_of_a_degree(seed):
    mesh = dented_box()
    moved, rotation, shift, scale = given_otherwise(mesh, seed)
    before = detect_symmetries(mesh, CONFIG, np.random.default_rng(0))
    after = detect_symmetries(moved, CONFIG, np.random.default_rng(0))
    assert [each.kind for each in before] == [each.kind for each in after]
    assert len(before) >= 3
    for one, other in zip(before, after, strict=True):
        cosine = abs((rotation @ one.direction) @ other.direction)
        assert np.degrees(np.arccos(min(1.0, cosine))) < 0.01
        offset = other.point - (rotation @ one.point * scale + shift)
        assert abs(offset @ other.direction) < 1e-5


def test_symmetries_are_returned_in_the_given_frame():
    box = dented_box()
    mesh = Mesh(box.vertices + np.array([0.3, -0.2, 0.5]), box.faces)
    pose, rng = CanonicalPose.of(mesh), np.random.default_rng(0)
    points = rng.normal(size=(20, 3))
    canonical = (points - pose.center) @ pose.rotation.T / pose.size
    normal = np.array([0.6, 0.0, 0.8])
    for symmetry in (
        ReflectionSymmetry(normal, np.array([0.1, 0.2, 0.3]), 0.1),
        RotationSymmetry(normal, np.array([0.1, 0.2, 0.3]), None, 0.1),
        SphereSymmetry(np.array([0.1, 0.2, 0.3]), 0.1),
    ):
        expected = symmetry.counterpart(canonical) @ pose.rotation * pose.size + pose.center
        assert_allclose(pose.given(symmetry).counterpart(points), expected, atol=1e-12)


def test_a_mesh_without_area_is_not_changed():
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert_allclose(CanonicalPose.of(flat).mesh.vertices, flat.vertices)
