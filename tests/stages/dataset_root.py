"""A dataset root of a few shapes on a table, seen by one perfect camera, made in a second."""

from pathlib import Path

import numpy as np
import trimesh

from pipelines.dataset.graspnet.graspnet import (
    GraspNetRoot,
    write_depth,
    write_label,
)
from pipelines.dataset.graspnet.graspnet_labels import GraspLabel, label_offsets, write_grasp_label
from pipelines.dataset.graspnet.graspnet_views import view_rotations
from pipelines.dataset.meshes import write_mesh
from pipelines.frames.graspnet_scene import (
    ObjectPose,
    write_annotation,
    write_meta,
    write_object_ids,
    write_pose_array,
)
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import invert, make_pose, random_rotation
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.contacts import close_fingers
from pipelines.storage.array_files import write_npy
from pipelines.storage.images import write_image

INTRINSICS = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
OPENING = 0.1
FRICTION_GRID = np.arange(1, 11) / 10.0


def shapes() -> list[Mesh]:
    """A box, a cylinder, and a ball joined to a tilted box: the last has two regions."""
    pair = [trimesh.creation.icosphere(3, 0.03), trimesh.creation.box((0.03, 0.05, 0.09))]
    turn = trimesh.transformations.rotation_matrix(1.1, (0.3, 1.0, 0.2), (0.0, 0.0, 0.0))
    turn[:3, 3] = (0.085, 0.02, 0.03)
    pair[1].apply_transform(turn)
    made = [
        trimesh.creation.box((0.12, 0.06, 0.04)),
        trimesh.creation.cylinder(0.03, 0.1, sections=64),
        trimesh.util.concatenate(pair),
    ]
    return [Mesh(np.asarray(m.vertices), np.asarray(m.faces)) for m in made]


def grasp_label(mesh: Mesh, num_points: int, rng: np.random.Generator) -> GraspLabel:
    """Label the whole grid at a few surface points by closing the fingers at each candidate."""
    points = sample_surface(mesh, num_points, rng)[0].astype(np.float32)
    depths = 0.01 * np.arange(1, 5)
    rotation = np.repeat(view_rotations().reshape(-1, 3, 3).astype(float), 4, axis=0)
    u, _, vt = np.linalg.svd(rotation)
    rotation = u @ vt
    friction = np.full((num_points, 300, 12, 4), -1.0, np.float32)
    for row, point in enumerate(points.astype(float)):
        tips = point + np.tile(depths, 3600)[:, None] * rotation[:, :, 0]
        contacts = close_fingers(
            mesh, GraspPoses(rotation, tips, np.full(len(tips), OPENING)), OPENING
        )
        cosines = np.where(contacts.found, contacts.cosines.min(axis=1), 0.0)
        needed = np.sqrt(1.0 - np.square(cosines.clip(1e-9, 1.0))) / cosines.clip(1e-9, 1.0)
        level = np.searchsorted(FRICTION_GRID, needed - 1e-12)
        holds = level < len(FRICTION_GRID)
        friction[row].reshape(-1)[holds] = FRICTION_GRID[level[holds]]
    width = np.full(friction.shape, OPENING, np.float32)
    return GraspLabel(points, label_offsets(width), np.zeros(friction.shape, bool), friction)


def write_root(folder: Path, *, num_frames: int = 2, num_points: int = 2) -> GraspNetRoot:
    """Write models, grasp labels and one scene of `shapes()`; the same bytes every time."""
    root, meshes, rng = GraspNetRoot(folder), shapes(), np.random.default_rng(0)
    for object_id, mesh in enumerate(meshes):
        write_mesh(root.model_path(object_id), mesh)
        label = grasp_label(mesh, num_points, rng)
        write_grasp_label(root.grasp_label_path(object_id), label)
    write_object_ids(root.scene_folder(0) / "object_id_list.txt", range(len(meshes)))
    camera = root.scene_folder(0) / "realsense"
    write_npy(camera / "camK.npy", INTRINSICS.matrix)
    write_pose_array(camera / "camera_poses.npy", np.tile(np.eye(4), (num_frames, 1, 1)))
    write_pose_array(camera / "cam0_wrt_table.npy", np.eye(4))
    for frame_id in range(num_frames):
        _write_frame(camera, frame_id, meshes, rng)
    return root


def _write_frame(camera: Path, frame_id: int, meshes: list[Mesh], rng: np.random.Generator) -> None:
    poses = [
        make_pose(random_rotation(rng), (0.17 * (index - 1), 0.0, 0.6))
        for index in range(len(meshes))
    ]
    hits = cast_view(Scene(meshes, poses), INTRINSICS, invert(np.eye(4)))
    name = f"{frame_id:04d}"
    # The table is behind all objects, so that leaking masks contain measured points.
    write_depth(camera / "depth" / f"{name}.png", np.where(hits.depth > 0, hits.depth, 0.8))
    write_label(camera / "label" / f"{name}.png", hits.object_index + 1)
    shade = np.clip(255 * -hits.normal[..., 2:], 0, 255).astype(np.uint8)
    write_image(camera / "rgb" / f"{name}.png", np.repeat(shade, 3, axis=2))
    objects = [ObjectPose(index, pose) for index, pose in enumerate(poses)]
    write_annotation(camera / "annotations" / f"{name}.xml", objects)
    write_meta(camera / "meta" / f"{name}.mat", objects, INTRINSICS.matrix)
