"""Completion of regions: their unseen sides as images of the seen sides (D. 32, D. 85).

A symmetry maps the seen side of a region onto its unseen side. No gripper may enter the unseen
side, neither for a grasp of the region itself nor for a grasp of its neighbour.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import SymmetryConfig
from pipelines.geometry.pointcloud import voxel_downsample
from pipelines.geometry.symmetry import RotationSymmetry, Symmetry, SymmetrySlots
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.observed_frustum import in_observed_frustum

COMPLETING_TURNS = np.radians(np.arange(45.0, 360.0, 45.0))


@dataclass(frozen=True)
class Completion:
    """Expected points that the camera does not see. Camera frame, metres.

    Attributes:
        own: (h, 3) points of a region.
        others: (m, 3) points of all other regions.
    """

    own: Array
    others: Array

    @classmethod
    def none(cls) -> "Completion":
        """Return no points."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)))


def completions(
    regions: Sequence[RegionCloud],
    scene: SceneCloud,
    symmetries: Sequence[SymmetrySlots],
    config: SymmetryConfig,
    resolution: float,
) -> list[Completion]:
    """Return the completion of each region of a frame, thinned to `resolution` metres.

    `symmetries`: symmetries of each region. A neighbour's unseen side needs less confidence to be
    an obstacle than the region's own unseen side.
    """
    own, beside = [], []
    for region, known in zip(regions, symmetries, strict=True):
        least = config.least_confidence
        sure = known.between(max(config.min_completion_confidence, least))
        likely = known.between(max(config.min_neighbor_confidence, least))
        beside.append(hidden_points(region, likely, scene, resolution))
        same = len(sure) == len(likely)  # the symmetries of the stricter bound are a subset
        own.append(beside[-1] if same else hidden_points(region, sure, scene, resolution))
    return [
        Completion(mine, np.concatenate([np.zeros((0, 3)), *beside[:index], *beside[index + 1 :]]))
        for index, mine in enumerate(own)
    ]


def hidden_points(
    region: RegionCloud,
    symmetries: Sequence[tuple[int, Symmetry]],
    scene: SceneCloud,
    resolution: float,
) -> Array:
    """Return the images (h, 3) of the points of `region`, on or behind the seen surface."""
    images = [np.zeros((0, 3))]
    for _, symmetry in symmetries:
        if isinstance(symmetry, RotationSymmetry):
            images.append(symmetry.turn(region.points, COMPLETING_TURNS).reshape(-1, 3))
        else:
            images.append(symmetry.counterpart(region.points))
    points = np.concatenate(images)
    points = points[voxel_downsample(points, resolution)]
    return points[in_observed_frustum(points, scene)]
