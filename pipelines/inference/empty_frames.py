"""Why a frame has no grasps, in a sentence."""

from collections.abc import Sequence

from pipelines.grasping.feasibility.limits import Limits
from pipelines.grasping.observation import RegionCloud
from pipelines.grasping.region_grasping import MIN_POINTS
from pipelines.inference.regions import FrameRegions


def why_empty(
    found: FrameRegions,
    clouds: Sequence[RegionCloud],
    num_within: int,
    limits: Limits | None,
    mask_pixels: int | None = None,
) -> str:
    """Return why no region of a frame has a grasp.

    Args:
        found: the regions.
        clouds: the points of each of them.
        num_within: how many of them reach into the workspace.
        limits: what grasps must keep to; None for nothing.
        mask_pixels: how many an instance of the user's masks needs; None where there are no masks.
    """
    if mask_pixels is None:
        return _of_regions(clouds, num_within, limits)
    total = len(found.regions) + found.too_small
    if not total:
        return "the masks show no instance; the pixels of each have its number, from 1"
    reasons = [_of_regions(clouds, num_within, limits)] if found.regions else []
    if found.too_small:
        small = f"{found.too_small} of {total} instances of the masks were dropped as too small"
        reasons += [small, f"an instance needs {mask_pixels} pixels"]
    return "; ".join(reasons)


def _of_regions(clouds: Sequence[RegionCloud], num_within: int, limits: Limits | None) -> str:
    if clouds and all(len(cloud) < MIN_POINTS for cloud in clouds):
        measured = f"no depth, or too little, was measured in {len(clouds)} regions"
        return f"{measured}; a region needs {MIN_POINTS} points"
    if limits is not None and clouds and not num_within:
        return f"none of {len(clouds)} regions lies in the workspace"
    if limits is not None and num_within:
        return f"none of {num_within} regions in the workspace has a grasp within the limits given"
    if num_within == 0:
        return "nothing stands out from its support; is an object within reach of the camera?"
    return f"none of {num_within} regions has a grasp that the gripper reaches without collision"
