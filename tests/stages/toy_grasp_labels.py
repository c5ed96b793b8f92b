"""Grasp labels of the toy dataset: every hand of an object holds equally well."""

import numpy as np

from pipelines.dataset.graspnet.graspnet_labels import (
    LABEL_GRID,
    GraspLabel,
    label_offsets,
    write_collision_labels,
    write_grasp_label,
    write_rect,
)
from pipelines.dataset.meshes import read_mesh
from pipelines.geometry.meshes.mesh import sample_surface
from tests.stages.toy_root import CAMERA, WIDTHS, best_grasp, frame_names

NUM_LABELLED = 30
OPENING = np.float32(0.07)  # metres, of every hand
FRICTION = {0: 0.2, 1: 0.5, 2: -1.0}  # of the hands of the box, the can and the ball


def write_labels(root, hindered=()):
    """Label points of each object's surface; all hands of `hindered` objects meet the scene."""
    rng = np.random.default_rng(0)
    shape = (NUM_LABELLED, *LABEL_GRID)
    for object_id, friction in FRICTION.items():
        points = sample_surface(read_mesh(root.model_path(object_id)), NUM_LABELLED, rng)[0]
        offsets = label_offsets(np.full(shape, OPENING))
        scores = np.full(shape, friction, np.float32)
        label = GraspLabel(points.astype(np.float32), offsets, scores < 0, scores)
        write_grasp_label(root.grasp_label_path(object_id), label)
    for scene in root.scenes():
        path = root.collision_label_path(scene.scene_id)
        write_collision_labels(path, [np.full(shape, i in hindered) for i in scene.object_ids])


def write_rects(root) -> None:
    """Write a rectangle of the best grasp of each object, and one of a hidden object."""
    for name in frame_names():
        files, rows = root.frame(name), []
        for object_id in WIDTHS:
            grasp = best_grasp(object_id, files.frame_id)
            ends = np.stack([grasp.translation[0], grasp.contacts[0, 1]])
            (center, side) = CAMERA.project(ends)
            rows.append([*center, *side, 10.0, 1.0, object_id])
        rows.append([*rows[0][:6], 7])
        write_rect(files.path("rect"), np.array(rows))
