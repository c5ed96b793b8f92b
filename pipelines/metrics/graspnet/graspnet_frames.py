"""The grasps of a frame among its objects, as graspnetAPI scores them or exactly.

Both give each ranked grasp the protocol's smallest friction at which it holds. graspnetAPI has
contacts on signed-distance grids, collision of clouds of 8 mm voxels, poses in single precision.
The exact way has contacts where rays meet triangles, collision of triangles, an endless table.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.signed_distance import SignedDistanceGrid
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.grasps import GraspPoses, RowColumn, from_graspnet
from pipelines.metrics.contacts import Contacts, close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid
from pipelines.metrics.graspnet.box_collision import MIN_INNER, box_hits, meets_points, table_cloud
from pipelines.metrics.graspnet.graspnet_ap import AP_FRICTIONS, FAILED, ranked, suppress
from pipelines.metrics.graspnet.grid_contacts import close_fingers_on_grid
from pipelines.metrics.mesh_collision import MeshCollider, hits_table

# Outcomes of a ranked grasp, in the order in which it can fail.
DUMP_REASONS = ("collision", "empty", "no contact", "friction", "held")
OUTLIER = 0.05  # metres around an object's box within which points can collide
TABLE = table_cloud()


@dataclass(frozen=True)
class GridObject:
    """An object as graspnetAPI has it: cloud and distance grid, object frame, metres."""

    points: Array  # (m, 3), means of voxels
    grid: SignedDistanceGrid


@dataclass(frozen=True)
class SolidObject:
    """An exact object: points of its surface, mesh and collider; object frame, metres."""

    points: Array  # (m, 3)
    mesh: Mesh
    collider: MeshCollider


@dataclass(frozen=True)
class ScoredRows:
    """The grasps of a frame that count, most confident first; one entry per grasp."""

    index: Indices  # (k,) rows of the dump
    owner: Indices  # (k,) indices of the scene's objects
    friction: Array  # (k,) the smallest of `AP_FRICTIONS` that holds; else `FAILED`
    reason: Indices  # (k,) indices of `DUMP_REASONS`


@dataclass(frozen=True)
class GridScene:
    """A frame as graspnetAPI sees it; `around` (k, 3): points of walls and bins, table frame."""

    objects: Sequence[GridObject]
    poses: Sequence[Singles]  # T_cam_obj (4, 4)
    T_table_cam: Array
    around: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def clouds(self) -> list[Array]:
        """Return the points (m, 3) of each object, camera frame, that assign grasps to it."""
        pairs = zip(self.objects, self.poses, strict=True)
        return [transform_points(pose.astype(np.float64), each.points) for each, pose in pairs]

    def collisions(self, grasps: GraspPoses, depth: Array, owner: Indices) -> tuple[Mask, Mask]:
        """Return (n,) whether the open gripper meets something, and whether it is empty.

        Only points around the box of each grasp's object are tested.
        """
        clouds = self.clouds()
        table = transform_points(invert(self.T_table_cam), np.concatenate([TABLE, self.around]))
        everything = np.ascontiguousarray(np.concatenate([*clouds, table]).T)
        hit, inner = np.zeros(len(grasps), np.bool_), np.zeros(len(grasps), np.int64)
        for which in np.unique(owner):
            mine, cloud = owner == which, clouds[which]
            low, high = cloud.min(axis=0) - OUTLIER, cloud.max(axis=0) + OUTLIER
            around = _within(everything, low, high)
            hit[mine], inner[mine] = meets_points(around, grasps[mine], depth[mine])
        return hit, inner < MIN_INNER

    def contacts(self, which: int, grasps: GraspPoses) -> Contacts:
        """Return contacts on the object's grid, with its pose inverted in single precision."""
        pose = self.poses[which]
        center = np.append(grasps.translation, np.ones((len(grasps), 1)), axis=1)
        local = GraspPoses(
            pose[:3, :3].T.astype(np.float64) @ grasps.rotation,
            (np.linalg.inv(pose).astype(np.float64) @ center.T).T[:, :3],
            grasps.width,
        )
        return close_fingers_on_grid(self.objects[which].grid, local, grasps.width)


@dataclass(frozen=True)
class ExactScene:
    """A frame with exact shapes and poses; `around`: walls and bins, table frame."""

    objects: Sequence[SolidObject]
    poses: Sequence[Array]  # T_cam_obj (4, 4)
    T_table_cam: Array
    around: Sequence[MeshCollider] = ()

    def clouds(self) -> list[Array]:
        """Return points (m, 3) of each object's surface, camera frame."""
        pairs = zip(self.objects, self.poses, strict=True)
        return [transform_points(pose, each.points) for each, pose in pairs]

    def collisions(self, grasps: GraspPoses, depth: Array, owner: Indices) -> tuple[Mask, Mask]:
        """Return (n,) whether the gripper's boxes meet triangles, and False for emptiness."""
        hit = box_hits(partial(hits_table, T_table_grasps=self.T_table_cam), grasps, depth)
        for each, pose in zip(self.objects, self.poses, strict=True):
            free = np.flatnonzero(~hit)
            local = grasps[free].transformed(invert(pose))
            hit[free] = box_hits(each.collider.hits, local, depth[free])
        for wall in self.around:
            free = np.flatnonzero(~hit)
            local = grasps[free].transformed(self.T_table_cam)
            hit[free] = box_hits(wall.hits, local, depth[free])
        return hit, np.zeros(len(owner), np.bool_)

    def contacts(self, which: int, grasps: GraspPoses) -> Contacts:
        """Return contacts on the object's triangles."""
        local = grasps.transformed(invert(self.poses[which]))
        return close_fingers(self.objects[which].mesh, local, grasps.width)


def score_rows(rows: Array, scene: GridScene | ExactScene) -> ScoredRows:
    """Return the outcomes of graspnetAPI's `rows` (n, 17), camera frame, metres."""
    confidence, origin = rows[:, RowColumn.SCORE], rows[:, RowColumn.TRANSLATION]
    kept = suppress(confidence, rows[:, RowColumn.ROTATION].reshape(-1, 3, 3), origin)
    clouds = scene.clouds()
    if not len(kept) or not clouds:
        none = np.zeros(0, np.int64)
        return ScoredRows(none, none, np.zeros(0), none)
    owner = _nearest(origin[kept], clouds)
    first = ranked(confidence[kept], owner)
    index, owner = kept[first], owner[first]
    grasps = from_graspnet(rows[index])
    hit, empty = scene.collisions(grasps, rows[index, RowColumn.DEPTH], owner)
    friction, touching = np.full(len(index), np.inf), np.zeros(len(index), np.bool_)
    for which in np.unique(owner):
        free = np.flatnonzero((owner == which) & ~hit & ~empty)
        contacts = scene.contacts(int(which), grasps[free])
        friction[free] = on_grid(min_friction(contacts), AP_FRICTIONS)
        touching[free] = contacts.found
    failures = [hit, empty, ~touching, np.isinf(friction)]
    reason = np.select(failures, range(len(failures)), len(failures))
    return ScoredRows(index, owner, np.where(np.isinf(friction), FAILED, friction), reason)


def _nearest(points: Array, clouds: Sequence[Array]) -> Indices:
    """Return (n,) the index of the cloud that holds the point nearest to each of `points`."""
    cloud_of_point = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    return np.asarray(cloud_of_point[cKDTree(np.concatenate(clouds)).query(points)[1]])


def _within(points: Array, low: Array, high: Array) -> Array:
    """Return the `points` (3, n) between two corners (3,), as (m, 3)."""
    for axis in range(3):
        points = points[:, (points[axis] > low[axis]) & (points[axis] < high[axis])]
    return points.T
