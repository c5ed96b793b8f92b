"""The reason why a frame has no grasps, in a sentence."""

from collections.abc import Sequence

import numpy as np

from pipelines.geometry.transforms import transform_points
from pipelines.grasping.planner import MIN_POINTS
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.inference.observation import Observation


def why_empty(seen: Observation, mask_pixels: int | None = None) -> str:
    """Return why no region of a frame has a grasp.

    `mask_pixels`: how many an instance of the user's masks needs; None where there are no masks.
    """
    if mask_pixels is None:
        return _of_regions(seen)
    total = len(seen.regions) + seen.too_small
    if not total:
        return "the masks show no instance; the pixels of each have its number, from 1"
    reasons = [_of_regions(seen)] if seen.regions else []
    if seen.too_small:
        small = f"{seen.too_small} of {total} instances of the masks were dropped as too small"
        reasons += [small, f"an instance needs {mask_pixels} pixels"]
    return "; ".join(reasons)


def why_weak(found: Sequence[RankedGrasps]) -> str:
    """Return that all grasps of the regions of a frame score too low; empty if there are none."""
    scores = [float(ranked.rank_score.max()) for ranked in found if len(ranked)]
    if not scores:
        return ""
    count = sum(map(len, found))
    return f"none of {count} grasps scores --min-score or more; the best has {max(scores):.3f}"


def _where(seen: Observation) -> str:
    """Return where the regions lie, as a box in the workspace's frame; of a mask in pixels too."""
    limits, clouds = seen.scene.limits, [cloud for cloud in seen.clouds if len(cloud)]
    if limits is None or not clouds:
        return "they have no depth"
    middles = transform_points(limits.T_box_cam, np.array([cloud.middle for cloud in clouds]))
    low, high = middles.min(axis=0), middles.max(axis=0)
    spans = zip("xyz", low, high, strict=True)
    frame = "camera" if np.array_equal(limits.T_box_cam, np.eye(4)) else "table"
    metres = ", ".join(f"{axis} {a:.2f} to {b:.2f}" for axis, a, b in spans)
    return f"their middles lie at {metres} m in the {frame}'s frame; see `symgrasp workspace`"


def _of_regions(seen: Observation) -> str:
    clouds, limits = seen.clouds, seen.scene.limits
    if clouds and all(len(cloud) < MIN_POINTS for cloud in clouds):
        measured = f"no depth, or too little, was measured in {len(clouds)} regions"
        return f"{measured}; a region needs {MIN_POINTS} points"
    if not clouds:
        return "nothing stands out from its support; is an object within reach of the camera?"
    inside = len(seen.in_workspace()[0])
    if not inside:
        return f"none of {len(clouds)} regions lies in the workspace; {_where(seen)}"
    if limits is not None:
        return f"none of {inside} regions in the workspace has a grasp within the limits given"
    return f"none of {inside} regions has a grasp that the gripper reaches without collision"
