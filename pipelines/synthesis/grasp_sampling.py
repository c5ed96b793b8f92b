"""Grasp labels of a mesh by sample-and-validate, on GraspNet-1Billion's grid.

Points are drawn from the surface. Each is tried from 300 views, at 12 angles about the approach
and at 4 depths of the finger tips. The fingers close on the line through their tips; a candidate
holds if both touch the object from outside, on their own side of the line's middle, and the
closed form of force closure asks for a friction of at most 1.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from pipelines.configs import LabelConfig
from pipelines.errors import ValueRangeError
from pipelines.formats.graspnet_labels import GRID, GraspLabel, label_offsets
from pipelines.formats.graspnet_views import DEPTHS, view_rotations
from pipelines.geometry.mesh import Mesh, sample_surface
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.grasps import Grasps
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid
from pipelines.synthesis.graspnet_gripper import FINGER, hits_plane, hits_samples

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NUM_SAMPLES = 4000  # of a surface, that the gripper's boxes must not hold
INFEASIBLE = -1.0  # GraspNet's word for a candidate that holds at no friction


def sample_grasp_label(mesh: Mesh, config: LabelConfig, rng: np.random.Generator) -> GraspLabel:
    """Return the grasp label of `mesh`, object frame, metres.

    `collision` is the gripper against the object itself; it is True wherever the friction is
    infeasible, and there untested. A width is the opening: it clears the farther contact by half
    of `config.width_margin`, and is 0 without contact.
    """
    _check_grid(config)
    # As written to the file: friction and collision are those of the rounded points.
    points = sample_surface(mesh, config.num_points, rng)[0].astype(np.float32)
    samples = sample_surface(mesh, NUM_SAMPLES, rng)[0]
    shape = (len(points), *GRID)
    friction, width = np.full(shape, INFEASIBLE, np.float32), np.zeros(shape, np.float32)
    collision = np.ones(shape, np.bool_)
    for i, point in enumerate(points.astype(np.float64)):
        friction[i], width[i] = _close_at(mesh, point, config)
        feasible = friction[i] > 0
        collision[i] = ~feasible | hits_samples(samples, point, feasible, width[i])
    return GraspLabel(points, label_offsets(width), collision, friction)


def _check_grid(config: LabelConfig) -> None:
    grid = (config.num_views, config.num_angles, len(config.depths))
    if grid != GRID or not np.allclose(config.depths, DEPTHS):
        found = f"{grid} with depths {config.depths}"
        expected = f"{GRID} with depths {tuple(DEPTHS.tolist())}, GraspNet's"
        raise ValueRangeError("views, angles and depths of grasp labels", found, expected)


def _close_at(mesh: Mesh, point: Array, config: LabelConfig) -> tuple[Array, Array]:
    """Return friction on the grid and opening, (300, 12, 4) each, of one point's candidates."""
    rotation = view_rotations().astype(np.float64)[:, :, None]  # (300, 12, 1, 3, 3)
    tips = point + DEPTHS[:, None] * rotation[..., 0]
    friction, width = np.full(GRID, INFEASIBLE), np.zeros(GRID)
    # The contacts lie within the fingers' line: elsewhere there are none.
    near = _within_bounds(mesh, tips)
    frames = np.broadcast_to(rotation, (*GRID, 3, 3))[near]
    grasps = Grasps(frames, tips[near], np.zeros(len(frames)))
    contacts = close_fingers(mesh, grasps, config.max_width)
    smallest = on_grid(min_friction(contacts), config.friction_grid)
    friction[near] = np.where(np.isfinite(smallest), smallest, INFEASIBLE)
    away = np.linalg.norm(contacts.points - grasps.translation[:, None], axis=-1).max(axis=1)
    opening = np.minimum(2.0 * away + config.width_margin, config.max_width)
    width[near] = np.where(contacts.found, opening, 0.0)
    return friction, width


def _within_bounds(mesh: Mesh, tips: Array) -> Mask:
    """Return whether `tips` (..., 3) lie in the mesh's bounding box: between any two contacts."""
    low, high = mesh.bounds
    return np.asarray(((tips >= low) & (tips <= high)).all(axis=-1))


def scene_collisions(
    labels: Sequence[GraspLabel],
    meshes: Sequence[Mesh],
    poses_world: Sequence[ArrayLike],
    *,
    config: LabelConfig,
    rng: np.random.Generator,
    table_height: float = 0.0,
) -> list[Mask]:
    """Return a scene's collision labels, (P_i, 300, 12, 4) for each object.

    True where the gripper meets another object or the table, and wherever the object's own label
    is infeasible or in collision with the object itself.

    Args:
        labels: of the objects, their own frames.
        meshes: of the objects, their own frames.
        poses_world: (4, 4) each, object to world, whose z points up.
        config: what the labels were made with.
        rng: draws the surfaces' samples.
        table_height: z of the table's top in the world, metres.
    """
    poses = [np.asarray(pose, np.float64) for pose in poses_world]
    surfaces = [
        transform_points(pose, sample_surface(mesh, NUM_SAMPLES, rng)[0])
        for mesh, pose in zip(meshes, poses, strict=True)
    ]
    collisions = []
    for i, (label, pose) in enumerate(zip(labels, poses, strict=True)):
        others = [surface for j, surface in enumerate(surfaces) if j != i]
        others_obj = transform_points(invert(pose), np.concatenate([np.zeros((0, 3)), *others]))
        collisions.append(_collides(label, pose, others_obj, table_height, config))
    return collisions


def _collides(
    label: GraspLabel, pose: Array, samples: Array, table_height: float, config: LabelConfig
) -> Mask:
    """Return (P, 300, 12, 4) which grasps of `label` meet `samples` (n, 3), object frame."""
    width = label.offsets[..., 2]
    height = transform_points(pose, label.points)[:, 2] - table_height
    hit = label.collision | (label.min_friction <= 0) | hits_plane(width, pose[2, :3], height)
    if not len(samples):
        return np.asarray(hit)
    reach = np.linalg.norm([config.max_width / 2 + FINGER, DEPTHS.max(), FINGER])
    near = cKDTree(samples).query_ball_point(label.points, float(reach), return_sorted=True)
    for i, neighbors in enumerate(near):
        hit[i] |= hits_samples(samples[neighbors], label.points[i], ~hit[i], width[i])
    return np.asarray(hit)
