"""Predicted symmetries are fitted to a rendered region and get a confidence."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import invert, make_pose, rotate_vectors, unit
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.grounding import Evidence, ground_symmetries
from pipelines.grasping.symmetries.plane_candidates import NETWORK, SHAPE
from pipelines.inference import models

CAMERA = Intrinsics(460.0, 460.0, 159.5, 119.5, 320, 240)
CRITICS = models.symmetry_critics()


def view_of(shape):
    """A scene with `shape` on a table seen from 45 degrees above, its region and its pose."""
    table = trimesh.creation.box((1.0, 1.0, 0.01))
    height = -float(shape.bounds[0, 2])
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = np.array([[1, 0, 0], [0, -np.sqrt(0.5), np.sqrt(0.5)], [0, 0, 0]])
    T_world_cam[2, :3] = [0, -np.sqrt(0.5), -np.sqrt(0.5)]
    T_world_cam[:3, 3] = [0, -0.4, 0.4 + height]
    meshes = [Mesh(shape.vertices, shape.faces), Mesh(table.vertices, table.faces)]
    poses = [make_pose(np.eye(3), [0, 0, height]), make_pose(np.eye(3), [0, 0, -0.005])]
    hits = cast_view(Scene(meshes, poses), CAMERA, T_world_cam)
    T_cam_world = invert(T_world_cam)
    up = rotate_vectors(T_cam_world, [0, 0, 1.0])
    scene = SceneCloud(hits.depth, CAMERA, Plane(up, -float(up @ T_cam_world[:3, 3])))
    return scene, RegionCloud.from_mask(hits.object_index == 0, scene), T_cam_world @ poses[0]


def disturbed(symmetry, degrees, rng):
    shift = rng.normal(0, 0.004, 3)
    turned = unit(symmetry.direction + np.tan(np.radians(degrees)) * unit(rng.normal(size=3)))
    field = "axis" if symmetry.kind == "rotation" else "normal"
    return replace(symmetry, **{field: turned, "point": symmetry.point + shift})


@pytest.fixture(scope="module")
def can():
    return view_of(trimesh.creation.cylinder(0.03, 0.1, sections=64))


@pytest.fixture(scope="module")
def box():
    return view_of(
        trimesh.creation.box((0.05, 0.09, 0.12)).apply_transform(
            trimesh.transformations.rotation_matrix(0.6, [0, 0, 1])
        )
    )


def uncertain(symmetries):
    slots = SymmetrySlots.from_symmetries(symmetries)
    full = [np.where(np.isnan(part), 0.5, part) for part in (slots.point, slots.direction)]
    return SymmetrySlots(
        np.full(5, 0.45), full[0] * [[0, 0, 1]], np.apply_along_axis(unit, 1, full[1])
    )


def test_the_axis_of_a_can_is_found_and_believed(can):
    scene, region, pose = can
    truth = RotationSymmetry([0, 0, 1], [0, 0, 0]).transformed(pose)
    slots = uncertain([disturbed(truth, 15, np.random.default_rng(0))])
    slots.point[:] = truth.point
    found = ground_symmetries(slots, region, scene, CRITICS)
    assert found.probability[3] > 0.5
    assert abs(float(found.direction[3] @ truth.axis)) > np.cos(np.radians(3))


def test_a_box_has_planes_but_no_axis(box):
    scene, region, pose = box
    turned = pose @ make_pose(np.eye(3), [0, 0, 0])
    angle = 0.6
    across = ReflectionSymmetry([np.cos(angle), np.sin(angle), 0], [0, 0, 0]).transformed(turned)
    slots = uncertain([disturbed(across, 8, np.random.default_rng(1))])
    slots.point[:] = across.point
    found = ground_symmetries(slots, region, scene, CRITICS)
    assert found.probability[3] < 0.5
    believed = [k for k in range(3) if found.probability[k] > 0.5]
    assert any(
        abs(float(found.direction[k] @ across.normal)) > np.cos(np.radians(6)) for k in believed
    )


def test_a_plane_that_throws_images_into_free_space_is_not_believed(can):
    scene, region, pose = can
    beside = ReflectionSymmetry([1, 0, 0], [0.03, 0, 0]).transformed(pose)
    slots = uncertain([beside])
    slots.point[:] = beside.point
    found = ground_symmetries(slots, region, scene, CRITICS)
    for slot in range(3):
        offset = abs(float((found.point[slot] - pose[:3, 3]) @ found.direction[slot]))
        assert found.probability[slot] < 0.5 or offset < 0.012


def test_more_support_and_fewer_floating_images_mean_more_confidence():
    axis = RotationSymmetry([0, 0, 1], [0, 0, 0])
    good, loose, floating = ([0.5, 0.8, 1.0], [0.5, 0.3, 1.0], [0.5, 0.8, 0.5])
    other = RotationSymmetry([1, 0, 0], [0, 0, 0])
    for worse in (loose, floating):
        both = Evidence([other, axis], np.array([worse, good]), np.array([NETWORK, SHAPE]))
        best, confidence, source = both.best(CRITICS.axes)
        assert best is axis
        assert source == SHAPE
        alone = Evidence([other], np.array([worse]), np.array([NETWORK]))
        assert confidence > alone.best(CRITICS.axes)[1]


def test_an_axis_that_several_starts_reach_has_all_their_sources():
    axis, same = RotationSymmetry([0, 0, 1], [0, 0, 0]), RotationSymmetry([0, 0, -1], [0, 0, 0.1])
    beside = RotationSymmetry([0, 0, 1], [0.01, 0, 0])
    tilted = RotationSymmetry([0, np.sin(0.3), np.cos(0.3)], [0, 0, 0])
    rows = np.array([[0.5, 0.8, 1.0], [0.5, 0.7, 1.0], [0.5, 0.3, 1.0]])
    for other, expected in ((same, NETWORK | SHAPE), (beside, NETWORK), (tilted, NETWORK)):
        found = Evidence([axis, other, other], rows, np.array([NETWORK, SHAPE, SHAPE]))
        assert found.best(CRITICS.axes)[2] == expected


def test_each_symmetry_names_network_or_shape_as_its_source(box):
    scene, region, pose = box
    across = ReflectionSymmetry([1, 0, 0], [0, 0, 0]).transformed(pose)
    slots = uncertain([across])
    slots.point[:] = across.point
    for candidates in ("network", "shape"):
        found = ground_symmetries(slots, region, scene, CRITICS, candidates)
        assert set(found.source[found.probability > 0]) == {candidates}
    found = ground_symmetries(slots, region, scene, CRITICS)
    assert set(found.source) <= {"network", "shape", "both"}
    assert len(set(found.source)) > 1
