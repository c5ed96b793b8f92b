"""Verdicts on grasps among true meshes: friction, quality, antipodal scores, cause of failure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.grasps import GraspPoses, to_graspnet
from pipelines.grasping.gripper import Gripper
from pipelines.metrics.antipodal import closing_region_score, contact_pair_score
from pipelines.metrics.contacts import Contacts, close_fingers
from pipelines.metrics.force_closure import MAX_FRICTION, min_friction, quality
from pipelines.metrics.graspnet.box_collision import voxel_means
from pipelines.metrics.graspnet.graspnet_ap import accuracy
from pipelines.metrics.graspnet.graspnet_frames import ExactScene, SolidObject, score_rows
from pipelines.metrics.mesh_collision import MeshCollider, hits_table

# Reasons for an object's score, in the order in which a grasp can fail.
REASONS = ("no region", "no grasp", "too wide", "collision", "no contact", "friction", "held")

GRASPNET_WIDTH = 0.1  # metres, largest opening of graspnetAPI's gripper
WIDTH_SLACK = 1e-6  # metres; widths are stored in single precision


@dataclass(frozen=True)
class TrueObject:
    """An object as input of the metrics: mesh, dense points of the surface, collider."""

    mesh: Mesh
    points: Array  # (m, 3) metres, object frame
    normals: Array  # (m, 3) unit
    collider: MeshCollider

    @cached_property
    def tree(self) -> KDTree:
        """Search tree over `points`."""
        return KDTree(self.points)

    @cached_property
    def solid(self) -> SolidObject:
        """The object as input of GraspNet's protocol."""
        return SolidObject(voxel_means(self.points), self.mesh, self.collider)


@dataclass(frozen=True)
class TrueScene:
    """All objects of a frame with their poses, the table and the surroundings."""

    objects: Mapping[int, TrueObject]  # by object id
    poses: Mapping[int, Array]  # `T_cam_obj` (4, 4) by object id
    T_table_cam: Array  # (4, 4); the table's top is z = 0, z up
    surroundings: Sequence[MeshCollider] = ()  # walls, bins and the like, table frame

    def nearest_object(self, points: Array) -> Indices:
        """Return (n,) the id of the object nearest to each of `points`; -1 without objects.

        `points`: (n, 3) camera frame.
        """
        ids = sorted(self.poses)
        if not ids:
            return np.full(len(points), -1)
        places = [transform_points(invert(self.poses[i]), points) for i in ids]
        pairs = zip(ids, places, strict=True)
        distances = np.stack([np.asarray(self.objects[i].tree.query(p)[0]) for i, p in pairs])
        return np.asarray(np.array(ids)[distances.argmin(axis=0)])

    def accuracy(self, grasps: GraspPoses, score: Array, gripper: Gripper) -> Array:
        """Return the accuracy (50, 6) of a frame's `grasps` by GraspNet's protocol, exactly.

        `grasps`: n, camera frame. `score`: (n,) higher is better. GraspNet's hand has fingers as
        long as those of `gripper`; its openings are limited to `GRASPNET_WIDTH`.
        """
        solids = [self.objects[each].solid for each in self.poses]
        scene = ExactScene(
            solids, list(self.poses.values()), self.T_table_cam, list(self.surroundings)
        )
        rows = to_graspnet(
            grasps,
            score,
            depth=gripper.graspnet_depth,
            opening=np.minimum(gripper.opening(grasps.width), GRASPNET_WIDTH),
            tip_reach=gripper.tip_reach,
        )
        return accuracy(score_rows(rows, scene).friction)


@dataclass(frozen=True)
class Verdict:
    """The verdict on the best grasp of one object."""

    object_id: int
    reason: str
    quality: float = 0.0
    min_friction: float = float("inf")
    antipodal: float = 0.0
    antipodal_region: float = 0.0


def grasp_verdict(scene: TrueScene, object_id: int, grasp: GraspPoses, gripper: Gripper) -> Verdict:
    """Return the verdict on one `grasp` at the object `object_id`, camera frame.

    A grasp in collision or too wide has quality 0 and region score 0; friction and contact-pair
    score are computed nevertheless.
    """
    target = scene.objects[object_id]
    local = grasp.transformed(invert(scene.poses[object_id]))
    outcome = _outcomes(scene, object_id, grasp, gripper)
    friction, contacts = float(outcome.friction[0]), outcome.contacts
    too_wide, colliding = bool(outcome.too_wide[0]), bool(outcome.colliding[0])
    region = closing_region_score(
        target.points, target.normals, local, gripper, _other_points(scene, object_id)
    )
    return Verdict(
        object_id,
        _reason(too_wide, colliding, bool(contacts.found[0]), friction),
        float(outcome.quality[0]),
        friction,
        float(contact_pair_score(contacts)[0]),
        0.0 if too_wide or colliding else float(region[0]),
    )


def qualities(scene: TrueScene, object_id: int, grasps: GraspPoses, gripper: Gripper) -> Array:
    """Return (n,) the quality of n `grasps`, camera frame, as in `grasp_verdict`, all at once."""
    return _outcomes(scene, object_id, grasps, gripper).quality


@dataclass(frozen=True)
class _Outcomes:
    """Contacts, friction and failures of n grasps at one object."""

    contacts: Contacts
    friction: Array  # (n,) the smallest that holds
    too_wide: Mask
    colliding: Mask

    @property
    def quality(self) -> Array:
        """Quality (n,), 0 to 1; 0 for grasps that are too wide or collide."""
        return quality(self.friction, self.too_wide | self.colliding)


def _outcomes(scene: TrueScene, object_id: int, grasps: GraspPoses, gripper: Gripper) -> _Outcomes:
    local = grasps.transformed(invert(scene.poses[object_id]))
    contacts = close_fingers(scene.objects[object_id].mesh, local, gripper.opening(local.width))
    return _Outcomes(
        contacts,
        min_friction(contacts),
        np.asarray(grasps.width > gripper.max_width + WIDTH_SLACK),
        collides(scene, grasps, gripper),
    )


def collides(scene: TrueScene, grasps: GraspPoses, gripper: Gripper) -> Mask:
    """Return (n,) whether the open gripper touches an object, the table or the surroundings.

    `grasps`: camera frame.
    """
    hit = hits_table(grasps, gripper, scene.T_table_cam)
    if scene.surroundings:
        on_table = grasps.transformed(scene.T_table_cam)
        for solid in scene.surroundings:
            hit |= solid.hits(on_table, gripper)
    for object_id, pose in scene.poses.items():
        hit |= scene.objects[object_id].collider.hits(grasps.transformed(invert(pose)), gripper)
    return hit


def _other_points(scene: TrueScene, object_id: int) -> Array:
    """Return the surface points of all other objects in the frame of `object_id`."""
    to_object = invert(scene.poses[object_id])
    parts = [
        transform_points(to_object @ pose, scene.objects[other].points)
        for other, pose in scene.poses.items()
        if other != object_id
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _reason(too_wide: bool, colliding: bool, touching: bool, friction: float) -> str:
    if too_wide:
        return "too wide"
    if colliding:
        return "collision"
    if not touching:
        return "no contact"
    return "held" if friction <= MAX_FRICTION else "friction"
