"""Collision of GraspNet's box gripper with objects: exact triangles, or graspnetAPI's clouds.

The fingers are 1 cm thick and 2 cm high and reach from 2 cm behind the grasp's origin to the tips;
the bottom is a slab of 1 cm behind them. `depth` is the distance of the tips past the origin.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import GRASPNET_BACK, Gripper
from pipelines.metrics.mesh_collision import MeshCollider

FINGER = 0.01  # metres: thickness of a finger and of the bottom, half a finger's height
VOXEL = 0.008  # metres, of graspnetAPI's cloud
MIN_INNER = 10  # points of the cloud between the fingers; with fewer the grasp is empty
NUM_CLOUD_SAMPLES = 40000
AT_A_TIME = 2_000_000  # pairs of a grasp and a point
LONGEST = 0.9  # metres, of a finger
TABLE_SIDE, TABLE_DEPTH = 1.0, 0.05  # metres, of graspnetAPI's cloud


def exact_collision(mesh: Mesh, grasps: GraspPoses, depth: Array) -> tuple[Mask, Mask]:
    """Return (n,) whether the open gripper meets `mesh`, and whether it encloses nothing.

    `grasps`: mesh frame, metres, `translation` between the finger tips and `width` the opening.
    """
    collision = box_hits(MeshCollider(mesh).hits, grasps, depth)
    samples = sample_surface(mesh, NUM_CLOUD_SAMPLES, np.random.default_rng(0))[0]
    return collision, meets_points(samples, grasps, depth)[1] == 0


def box_hits(hits: Callable[[GraspPoses, Gripper], Mask], grasps: GraspPoses, depth: Array) -> Mask:
    """Return (n,) whether the open box gripper with each `depth` (n,) collides, by `hits`."""
    collision = np.zeros(len(grasps), np.bool_)
    for reach in np.unique(depth):
        some = np.flatnonzero(depth == reach)
        collision[some] = hits(grasps[some], _box_gripper(float(reach)))
    return collision


def cloud_collision(mesh: Mesh, grasps: GraspPoses, depth: Array) -> tuple[Mask, Mask]:
    """Return (n,) collision and emptiness as in graspnetAPI; empty grasps count as colliding.

    graspnetAPI draws its cloud at random, so results can differ where a voxel decides.
    """
    samples = sample_surface(mesh, NUM_CLOUD_SAMPLES, np.random.default_rng(0))[0]
    hit, inner = meets_points(voxel_means(samples), grasps, depth)
    empty = inner < MIN_INNER
    return hit | empty, empty


def voxel_means(points: Array) -> Array:
    """Return the mean of the points (n, 3) in each voxel of edge `VOXEL`: (m, 3).

    The first voxel's corner lies half a voxel below the lowest coordinates, as in Open3D.
    """
    corner = points.min(axis=0) - VOXEL * 0.5
    voxel = np.floor((points - corner) / VOXEL).astype(np.int64)
    index = np.unique(voxel, axis=0, return_inverse=True)[1].reshape(-1)
    count = np.bincount(index)
    return np.stack([np.bincount(index, column) / count for column in points.T], axis=1)


def table_cloud() -> Array:
    """Return graspnetAPI's table (93750, 3), table frame, top z = 0: 8 mm apart, 5 cm deep."""
    side = np.linspace(0.0, TABLE_SIDE, int(TABLE_SIDE / VOXEL)) - TABLE_SIDE / 2.0
    height = np.linspace(0.0, TABLE_DEPTH, int(TABLE_DEPTH / VOXEL)) - TABLE_DEPTH
    return np.stack(np.meshgrid(side, side, height), -1).reshape(-1, 3)


def meets_points(points: Array, grasps: GraspPoses, depth: Array) -> tuple[Mask, NDArray[np.int64]]:
    """Return (n,) whether a box of the gripper holds a point, and (n,) points between the fingers.

    `points`: (m, 3) metres, frame of `grasps`; `translation` of the grasps is between the finger
    tips, `width` is the opening. `depth`: (n,) metres from GraspNet's origin to the tips.
    """
    hit, inner = np.zeros(len(grasps), np.bool_), np.zeros(len(grasps), np.int64)
    step = max(1, AT_A_TIME // max(len(points), 1))
    for start in range(0, len(grasps), step):
        part = slice(start, start + step)
        some, tips = grasps[part], depth[part, None]
        turn = some.rotation.swapaxes(1, 2)
        local = turn @ points.T - turn @ some.translation[..., None]  # (n, 3, m)
        along, across = local[:, 0] + tips, np.abs(local[:, 1])
        half = some.width[:, None] / 2.0
        level = np.abs(local[:, 2]) < FINGER
        reached = level & (along > -GRASPNET_BACK) & (along < tips)
        fingers = reached & (across > half) & (across < half + FINGER)
        bottom = (
            level
            & (along > -GRASPNET_BACK - FINGER)
            & (along < -GRASPNET_BACK)
            & (across < half + FINGER)
        )
        hit[part] = (fingers | bottom).any(axis=1)
        inner[part] = (reached & (across <= half)).sum(axis=1)
    return hit, inner


def _box_gripper(depth: float) -> Gripper:
    return Gripper(
        name="graspnet",
        max_opening=0.5,
        finger_length=float(np.clip(depth + GRASPNET_BACK, 0.0, LONGEST)),
        finger_thickness=FINGER,
        finger_height=2.0 * FINGER,
        palm_depth=FINGER,
        palm_width=0.0,
        palm_height=2.0 * FINGER,
        tip_reach=0.0,
        clearance=0.0,
        flange_to_tip=0.0,
    )
