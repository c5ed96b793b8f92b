"""Antipodal scores after S4G, by two definitions that give different numbers.

*Contact pair* (Sec. IV-A of the paper): `|cos a_1 cos a_2|` at the two contacts. *Closing region*:
from the mean normals of the outermost layers of surface between the fingers. Both are 1 for a
perfect grasp and 0 for a useless grasp.
"""

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.metrics.contacts import Contacts

LAYER_DEPTH = 0.005  # metres of surface, from the outermost point inwards, that a finger feels
MIN_REGION_POINTS = 10


def contact_pair_score(contacts: Contacts) -> Array:
    """Return (n,) `|cos a_1 cos a_2|` of the contacts; 0 where fingers do not touch."""
    return np.where(contacts.found, np.abs(np.prod(contacts.cosines, axis=1)), 0.0)


def closing_region_score(
    points: Array, normals: Array, grasps: GraspPoses, gripper: Gripper, foreign_points: Array
) -> Array:
    """Return (n,) the score of the surface between the open fingers of n `grasps`.

    `points`: (m, 3) metres, on the object's whole surface, in the frame of the grasps. `normals`:
    (m, 3) unit. `foreign_points`: (k, 3) on other objects; a region with a foreign point scores 0.
    """
    inner = _closing_regions(grasps, gripper)

    scores = np.zeros(len(grasps))
    for i in range(len(grasps)):
        rotation, origin = grasps.rotation[i], grasps.translation[i]
        if _within((foreign_points - origin) @ rotation, inner[i]).any():
            continue
        local = (points - origin) @ rotation
        inside = _within(local, inner[i])
        scores[i] = _layers_score(local[inside, 1], (normals[inside] @ rotation)[:, 1])
    return scores


def _closing_regions(grasps: GraspPoses, gripper: Gripper) -> Array:
    """Return (n, 2, 3) low and high corners, grasp frame, of the boxes that the fingers sweep."""
    fingers = gripper.boxes(grasps.width)[:, :2]
    regions = fingers[:, 0].copy()
    regions[:, 0, 1], regions[:, 1, 1] = fingers[:, 0, 1, 1], fingers[:, 1, 0, 1]
    return regions


def _within(local: Array, corners: Array) -> Mask:
    return np.asarray(((local >= corners[0]) & (local <= corners[1])).all(axis=1))


def _layers_score(closing: Array, closing_normal: Array) -> float:
    """Return the score of region points from their coordinates along the closing axis."""
    if len(closing) < MIN_REGION_POINTS:
        return 0.0
    low, high = closing.min(), closing.max()
    layer = min((high - low) / 3.0, LAYER_DEPTH)
    left = np.abs(closing_normal[closing >= high - layer])
    right = np.abs(closing_normal[closing <= low + layer])
    return float(left.mean() * right.mean())
