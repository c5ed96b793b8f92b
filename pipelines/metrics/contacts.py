"""Contacts of closing fingers with a mesh: exact intersections of two rays with the triangles.

The two fingers start half the opening away from the grasp's midpoint and move towards the midpoint
along the closing axis; each stops at the first surface, or at the midpoint. A finger that starts
inside the object, or reaches the midpoint without touching anything, has no contact.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import first_hits
from pipelines.geometry.transforms import unit
from pipelines.grasping.grasps import GraspPoses

TRAVEL_SLACK = 1e-9  # metres; a surface exactly at the midpoint is still reached


@dataclass(frozen=True)
class Contacts:
    """Contact pairs of any number of grasps, in the frame of the grasps; nan without contact."""

    points: Array  # (n, 2, 3) metres; first the finger that starts at -closing
    normals: Array  # (n, 2, 3) unit, pointing out of the object
    found: Mask  # (n,) whether both fingers touch the object

    @property
    def cosines(self) -> Array:
        """(n, 2) cosines between the inward normals and the contact line; nan without contact."""
        line = unit(self.points[:, 1] - self.points[:, 0])
        towards = np.stack([line, -line], 1)  # from each contact to the other
        return np.asarray(-np.einsum("nki,nki->nk", self.normals, towards))


def close_fingers(mesh: Mesh, grasps: GraspPoses, opening: ArrayLike) -> Contacts:
    """Return the contacts of `grasps` on `mesh`, both in one frame, metres.

    `opening`: (n,) or one number, distance of the fingers before they close.
    """
    reach = np.broadcast_to(np.asarray(opening, np.float64) / 2.0, grasps.width.shape)
    inward = np.stack([grasps.closing, -grasps.closing], 1)
    start = grasps.translation[:, None] - reach[:, None, None] * inward
    distance, triangle = first_hits(mesh, start.reshape(-1, 3), inward.reshape(-1, 3))
    travel = distance.reshape(-1, 2)
    normals = mesh.face_normals[triangle].reshape(-1, 2, 3)
    # A hit on the back of a surface means that the finger started inside the object.
    outside = np.einsum("nki,nki->nk", inward, normals) < 0.0
    touched = outside & (travel <= reach[:, None] + TRAVEL_SLACK)
    points = start + np.where(touched, travel, 0.0)[..., None] * inward
    found = np.asarray(touched.all(axis=1))
    points[~found], normals[~found] = np.nan, np.nan
    return Contacts(points, normals, found)
