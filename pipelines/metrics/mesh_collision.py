"""Exact collision of a gripper's boxes with triangle meshes, by FCL, and with a table."""

import fcl
import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import first_hits
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper


class MeshCollider:
    """A mesh prepared for collision queries, in its own frame.

    FCL tests surfaces: a box wholly inside a solid touches no triangle. A ray from the box's centre
    finds this case: it leaves the solid through the back of a surface.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._center = mesh.vertices.mean(axis=0)
        self._radius = float(np.linalg.norm(mesh.vertices - self._center, axis=1).max())
        model = fcl.BVHModel()
        model.beginModel(len(mesh.vertices), len(mesh.faces))
        model.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        model.endModel()
        self._object = fcl.CollisionObject(model, fcl.Transform())

    def hits(self, grasps: GraspPoses, gripper: Gripper) -> Mask:
        """Return (n,) whether any box of the open `gripper` touches the mesh or is inside.

        `grasps`: in the frame of the mesh, metres.
        """
        boxes = gripper.boxes(grasps.width)
        size = boxes[:, :, 1] - boxes[:, :, 0]
        middle = boxes.mean(axis=2)
        centers = grasps.translation[:, None] + np.einsum("nij,nkj->nki", grasps.rotation, middle)
        reach = self._radius + np.linalg.norm(size, axis=-1) / 2.0
        near = np.linalg.norm(centers - self._center, axis=-1) <= reach
        touching = np.zeros(near.shape, np.bool_)
        for grasp, box in zip(*np.nonzero(near), strict=True):
            pose = fcl.Transform(grasps.rotation[grasp], centers[grasp, box])
            touching[grasp, box] = self._touches(fcl.Box(*size[grasp, box]), pose)
        enclosed = near & ~touching
        touching[enclosed] = self._contains(centers[enclosed])
        return np.asarray(touching.any(axis=1))

    def _touches(self, box: fcl.Box, pose: fcl.Transform) -> bool:
        found = fcl.CollisionResult()
        body = fcl.CollisionObject(box, pose)
        return bool(fcl.collide(body, self._object, fcl.CollisionRequest(), found))

    def _contains(self, points: Array) -> Mask:
        if len(points) == 0:
            return np.zeros(0, np.bool_)
        _, triangle = first_hits(self.mesh, points, np.broadcast_to([0.0, 0.0, 1.0], points.shape))
        leaves = self.mesh.face_normals[np.maximum(triangle, 0), 2] > 0.0
        return np.asarray((triangle >= 0) & leaves)


def hits_table(grasps: GraspPoses, gripper: Gripper, T_table_grasps: Array) -> Mask:
    """Return (n,) whether any box of the open `gripper` reaches below the table.

    `T_table_grasps`: frame of `grasps` to table frame; the table's top is z = 0, z up.
    """
    boxes = gripper.boxes(grasps.width)
    choice = np.indices((2, 2, 2)).reshape(3, -1)  # which corner, low or high, along each axis
    corners = boxes[:, :, choice, np.arange(3)[:, None]]  # (n, boxes, 3, 8)
    turned = np.einsum("nij,nkjc->nkci", grasps.rotation, corners)
    corners_table = transform_points(T_table_grasps, grasps.translation[:, None, None] + turned)
    return np.asarray(corners_table[..., 2].min(axis=(1, 2)) < 0.0)
