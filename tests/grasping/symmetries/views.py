"""Rendered regions of simple shapes on a table, as evidence for their symmetries."""

import numpy as np
import trimesh

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.transforms import invert, make_pose, rotate_vectors, unit
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.region_evidence import RegionEvidence

CAMERA = Intrinsics(460.0, 460.0, 159.5, 119.5, 320, 240)
# A network that believes in nothing and is wrong.
SILENT = SymmetrySlots(np.zeros(5), np.full((5, 3), 9.0), np.tile(unit([1.0, 2.0, 3.0]), (5, 1)))


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


def view_of_box():
    turn = trimesh.transformations.rotation_matrix(0.6, [0, 0, 1])
    return view_of(trimesh.creation.box((0.05, 0.09, 0.12)).apply_transform(turn))


def evidence_of(view, slots=SILENT):
    scene, region, _ = view
    return RegionEvidence.of(slots, region, scene)


def seen_box(size, toward, rng, n=3000):
    """Points and normals of the faces of a box, centred on 0, that face the viewer."""
    face, sign = rng.integers(3, size=n), rng.choice([-1.0, 1.0], n)
    points = rng.uniform(-0.5, 0.5, (n, 3))
    points[np.arange(n), face] = 0.5 * sign
    normals = np.eye(3)[face] * sign[:, None]
    front = normals @ unit(toward) > 0.1
    noisy = points[front] * size + rng.normal(0, 0.0005, (front.sum(), 3))
    return noisy, unit(normals[front] + rng.normal(0, 0.03, (front.sum(), 3)))
