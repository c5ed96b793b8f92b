"""Dumps of grasps for `toy_root`, its models with vertices as dense as a scan's."""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import write_mesh
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import rotation_about
from pipelines.grasping.grasps import GraspPoses, to_graspnet
from tests.stages import toy_root

Array = NDArray[np.float64]

DENSE = 0.006  # metres between vertices
PER_OBJECT = 60


def write_root(folder: Path) -> GraspNetRoot:
    root = toy_root.write_root(folder)
    for object_id, shape in toy_root.SHAPES.items():
        write_mesh(root.textured_path(object_id, ".obj"), _mesh(shape.vertices, shape.faces))
        dense = trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, DENSE)
        write_mesh(root.model_path(object_id), _mesh(*dense))
    return root


def _mesh(vertices: Array, faces: NDArray[np.int64]) -> Mesh:
    merged = trimesh.Trimesh(vertices, faces)
    return Mesh(np.asarray(merged.vertices), np.asarray(merged.faces))


def dumped_rows(frame_id: int, seed: int, noise: float = 1.0) -> Array:
    """Good grasps of each object, turned and shifted at random, with random confidence."""
    rng = np.random.default_rng([seed, frame_id])
    grasps, count = [], PER_OBJECT
    for object_id in toy_root.SHAPES:
        best = toy_root.best_grasp(object_id, frame_id)
        for _ in range(count):
            axis = rng.normal(size=3)
            turn = rotation_about(axis / np.linalg.norm(axis), noise * 0.25 * rng.normal())
            shift = noise * 0.005 * rng.normal(size=3)
            grasps.append(GraspPoses(best.rotation @ turn, best.translation + shift, best.width))
    every = GraspPoses.concatenate(grasps)
    depth, opening = 0.01 * rng.integers(1, 4, len(every)), every.width + 0.03
    confidence = rng.random(len(every))
    rows = to_graspnet(every, confidence, opening=opening, depth=0.0, tip_reach=0.005)
    rows[:, 3] = depth
    rows[:, 13:16] -= depth[:, None] * every.approach
    return rows


def write_dump(dump: Path, seed: int = 0, noise: float = 1.0) -> Path:
    for scene_id in toy_root.SCENES:
        for frame_id in toy_root.FRAMES:
            path = frame_file(dump, scene_id, frame_id)
            path.parent.mkdir(parents=True, exist_ok=True)
            np.save(path, dumped_rows(frame_id, seed + scene_id, noise))
    return dump


def frame_file(dump: Path, scene_id: int, frame_id: int) -> Path:
    return dump / f"scene_{scene_id:04d}" / "realsense" / f"{frame_id:04d}.npy"
