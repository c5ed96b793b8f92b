"""Viewpoints that let a person judge symmetries."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import (
    invert,
    make_pose,
    random_rotation,
    rotate_vectors,
    transform_points,
)
from pipelines.geometry.viewpoints import camera, oblique_view, symmetry_view, view_along

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)


def box(T=None):
    shape = trimesh.creation.box((0.12, 0.06, 0.04))
    mesh = Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))
    return mesh if T is None else mesh.transformed(T)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_whole_object_is_in_the_picture_and_fills_it(seed):
    rng = np.random.default_rng(seed)
    mesh = box(make_pose(random_rotation(rng), rng.uniform(-1, 1, 3)))
    direction, up = random_rotation(rng)[:2]
    pose = view_along(mesh, direction, up)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert np.allclose(pose[:3, 2], direction)
    pixels = camera(100).project(transform_points(invert(pose), mesh.vertices))
    assert pixels.min() > 0
    assert pixels.max() < 99
    assert np.ptp(pixels, axis=0).max() > 60


def test_the_oblique_view_shows_no_plane_flat_or_edge_on():
    planes = [ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)]
    forward = oblique_view(box(), planes)[:3, 2]
    assert np.abs(forward).min() > 0.2
    assert np.abs(forward).max() < 0.9
    assert forward[2] < 0  # from above


def test_planes_are_seen_edge_on_and_one_of_them_upright():
    planes = [ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y)]
    pose = symmetry_view(box(), planes)
    seen = np.abs(rotate_vectors(invert(pose), np.stack([X, Y])))
    assert (seen[:, 2] < 1e-6).any()
    assert (seen[:, 0] > 0.999).any() or (seen[:, 1] > 0.999).any()


def test_one_plane_is_an_upright_line():
    pose = symmetry_view(box(), [ReflectionSymmetry(X, ORIGIN)])
    assert np.allclose(np.abs(rotate_vectors(invert(pose), X)), X, atol=1e-6)


def test_parts_that_share_a_plane_are_seen_along_it():
    planes = [ReflectionSymmetry(X, ORIGIN), ReflectionSymmetry(-X, ORIGIN)]
    pose = symmetry_view(box(), planes)
    assert np.allclose(np.abs(rotate_vectors(invert(pose), X)), X, atol=1e-6)


def test_the_view_is_along_a_round_axis():
    assert abs(symmetry_view(box(), [RotationSymmetry(Y, ORIGIN)])[:3, 2] @ Y) > 0.999


def test_an_object_without_symmetry_is_seen_from_the_other_side():
    first, second = oblique_view(box(), []), symmetry_view(box(), [])
    assert first[:3, 2] @ second[:3, 2] == pytest.approx(-1.0)
