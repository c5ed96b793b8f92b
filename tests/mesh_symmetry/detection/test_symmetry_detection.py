"""Detection against shapes whose symmetries are known, in any pose."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.errors import ValueRangeError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.mesh_symmetry.detection.symmetry_detection import analyse_body, detect_symmetries
from tests.geometry.symmetric_shapes import ball, box, cylinder, hex_prism, l_shape, pebble

QUICK = AnnotateSymmetryConfig(
    num_samples=8000, num_verification_samples=1000, plane_directions=400, axis_directions=250
)
TOLERANCE_DEG = 0.3
Z = np.eye(3)[2]


def detect(mesh, seed=0):
    return detect_symmetries(mesh, QUICK, np.random.default_rng(seed))


@cache
def symmetries_of(shape):
    return detect(shape())


def planes_of(symmetries):
    return [s for s in symmetries if isinstance(s, ReflectionSymmetry)]


def axes_of(symmetries):
    return [s for s in symmetries if isinstance(s, RotationSymmetry)]


def angle_deg(a, b):
    return np.degrees(np.arccos(min(1.0, abs(float(np.dot(a, b))))))


def assert_same_symmetries(found, expected, size):
    assert len(found) == len(expected)
    for symmetry in expected:
        alike = [other for other in found if other.kind == symmetry.kind]
        if symmetry.kind == "sphere":
            offset = np.linalg.norm(alike[0].point - symmetry.point)
            assert offset < 0.005 * size
            continue
        nearest = min(alike, key=lambda other: angle_deg(other.direction, symmetry.direction))
        assert angle_deg(nearest.direction, symmetry.direction) < TOLERANCE_DEG
        gap = nearest.counterpart(symmetry.point) - symmetry.point
        assert np.linalg.norm(gap) < 0.01 * size


def test_a_box_has_its_three_planes_and_no_continuous_axis():
    found = detect(box())
    normals = [plane.normal for plane in planes_of(found)]
    assert len(normals) == 3
    assert_allclose(np.sort(np.abs(normals).argmax(axis=1)), [0, 1, 2])
    assert all(angle_deg(n, np.eye(3)[np.abs(n).argmax()]) < TOLERANCE_DEG for n in normals)
    assert all(axis.order is not None for axis in axes_of(found))


def test_a_box_is_verified_on_all_samples_if_there_are_fewer_than_wanted():
    config = AnnotateSymmetryConfig(num_samples=1500)
    assert config.num_verification_samples > config.num_samples
    found = detect_symmetries(box(0.05, 0.07, 0.11), config, np.random.default_rng(0))
    assert len(planes_of(found)) == 3


def test_the_planes_of_a_cube_are_parallel_to_its_faces():
    found = detect(box(0.06, 0.06, 0.06))
    normals = np.abs([plane.normal for plane in planes_of(found)])
    assert_allclose(np.sort(normals.max(axis=1)), 1.0, atol=1e-3)


def test_a_cylinder_has_its_axis_and_the_plane_across_it():
    found = detect(cylinder())
    (axis,), (plane,) = axes_of(found), planes_of(found)
    assert axis.order is None
    assert angle_deg(axis.axis, [0, 0, 1]) < TOLERANCE_DEG
    assert angle_deg(plane.normal, [0, 0, 1]) < TOLERANCE_DEG


def test_a_cone_has_its_axis_and_no_plane():
    import trimesh

    cone = trimesh.creation.cone(0.04, 0.09, sections=64)
    found = detect(Mesh(np.asarray(cone.vertices), np.asarray(cone.faces)))
    assert [symmetry.kind for symmetry in found] == ["rotation"]
    assert found[0].order is None


def test_a_hexagonal_prism_has_a_sixfold_axis_and_no_continuous_one():
    found = detect(hex_prism())
    (axis,) = axes_of(found)
    assert axis.order is not None
    assert len(planes_of(found)) == 3


@pytest.mark.parametrize(("sides", "apart"), [(5, 72.0), (7, 77.1), (8, 90.0)])
def test_a_prism_has_an_axis_of_its_order_and_its_most_orthogonal_planes(sides, apart):
    for seed in range(3):
        turn = make_pose(random_rotation(np.random.default_rng(seed)), np.zeros(3))
        found = detect(cylinder(0.03, 0.05, sections=sides).transformed(turn))
        (axis,) = axes_of(found)
        assert axis.order == sides
        upright = [p for p in planes_of(found) if angle_deg(p.normal, axis.direction) > 45.0]
        assert len(upright) == 2
        assert angle_deg(upright[0].normal, upright[1].normal) == pytest.approx(apart, abs=1.0)


def test_a_ball_is_a_sphere_and_nothing_else():
    found = detect(ball())
    assert [symmetry.kind for symmetry in found] == ["sphere"]
    assert np.linalg.norm(found[0].point) < 1e-3


def test_an_l_with_unequal_arms_has_one_plane():
    (plane,) = planes_of(detect(l_shape()))
    assert angle_deg(plane.normal, [0, 0, 1]) < TOLERANCE_DEG


def test_a_pebble_has_no_symmetry():
    assert detect(pebble()) == []


@pytest.mark.parametrize("shape", [box, cylinder, hex_prism, l_shape, ball])
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_symmetries_move_with_the_mesh(shape, seed):
    rng = np.random.default_rng(seed)
    mesh, T = shape(), make_pose(random_rotation(rng), rng.normal(size=3))
    expected = [symmetry.transformed(T) for symmetry in symmetries_of(shape)]
    found = detect(mesh.transformed(T))
    if shape is hex_prism:  # any two upright planes at right angles are right
        assert [s.kind for s in found] == [s.kind for s in expected]
        return
    assert_same_symmetries(found, expected, mesh.diagonal)


def test_the_order_of_vertices_and_flipped_faces_change_nothing():
    mesh, rng = l_shape(), np.random.default_rng(3)
    order = rng.permutation(len(mesh.vertices))
    rank = np.argsort(order)
    shuffled = Mesh(mesh.vertices[order], rank[mesh.faces][::-1, ::-1])
    assert_same_symmetries(detect(shuffled), detect(mesh), mesh.diagonal)


@pytest.mark.parametrize("corners", [np.zeros((3, 3)), np.outer([0.0, 1.0, 2.0], np.ones(3))])
def test_a_mesh_without_area_is_an_error_in_one_sentence(corners):
    with pytest.raises(ValueRangeError, match="area"):
        detect(Mesh(corners, np.array([[0, 1, 2]])))


def test_doubled_degenerate_and_unused_parts_change_nothing():
    mesh = l_shape()
    extra = np.concatenate([mesh.faces, mesh.faces[:, ::-1], [[0, 0, 1]]])
    messy = Mesh(np.concatenate([mesh.vertices, [[9.0, 9.0, 9.0]]]), extra)
    assert_same_symmetries(detect(messy), detect(mesh), mesh.diagonal)


def test_the_same_seed_gives_the_same_numbers():
    first, second = detect(box(), seed=5), detect(box(), seed=5)
    for a, b in zip(first, second, strict=True):
        assert_allclose(a.point, b.point, rtol=0, atol=0)
        assert_allclose(a.direction, b.direction, rtol=0, atol=0)


def test_the_error_is_far_below_the_threshold_of_a_true_positive():
    errors = [symmetry.error for symmetry in detect(cylinder())]
    assert 0.0 <= min(errors) <= max(errors) < 0.02


def test_a_sphere_with_a_cap_cut_off_is_no_sphere():
    mesh = ball()
    kept = mesh.triangles.mean(axis=1)[:, 2] < 0.0
    found = detect(mesh.submesh(kept))
    assert not any(isinstance(symmetry, SphereSymmetry) for symmetry in found)
    assert [axis.order for axis in axes_of(found)] == [None]


def test_a_body_known_to_be_round_gets_its_own_axis_from_a_rough_guess():
    tilt = np.radians(2.0)
    guess = RotationSymmetry([np.sin(tilt), 0.0, np.cos(tilt)], [0.001, 0.0, 0.0])
    plane, axis = analyse_body(cylinder(), guess, QUICK, np.random.default_rng(0))
    assert angle_deg(axis.axis, Z) < 0.1
    assert angle_deg(plane.normal, Z) < 0.1


def test_a_wrong_guess_is_kept_where_no_better_axis_is_found():
    guess = RotationSymmetry(Z, np.zeros(3))
    axis = analyse_body(box(), guess, QUICK, np.random.default_rng(0))[-1]
    assert angle_deg(axis.axis, Z) < 1e-6
    assert axis.error > 0.03


def test_a_body_with_the_shape_of_a_ball_is_a_sphere():
    found = analyse_body(ball(), RotationSymmetry(Z, np.zeros(3)), QUICK, np.random.default_rng(0))
    assert [each.kind for each in found] == ["sphere"]
