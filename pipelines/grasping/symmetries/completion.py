"""The sides of regions that the camera does not see, as images of the seen ones (D. 32, D. 85).

A symmetry maps the seen side of a region onto its unseen one. No gripper should be there: neither
one at the region itself nor one at its neighbour.
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
    """Points that are expected where the camera does not see. Camera frame, metres.

    Attributes:
        own: (h, 3) of a region.
        others: (m, 3) of all other regions.
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

    `symmetries`: of each region. Less confidence is needed to keep off the far side of a neighbour
    than to say where the own one is.
    """
    own, beside = [], []
    for region, known in zip(regions, symmetries, strict=True):
        least = config.least_confidence
        sure = known.between(max(config.min_completion_confidence, least))
        likely = known.between(max(config.min_neighbour_confidence, least))
        beside.append(hidden_points(region, likely, scene, resolution))
        same = len(sure) == len(likely)  # one bound's symmetries are among the other's
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
    """Return (h, 3) points of `region` that `symmetries` put where nothing is seen."""
    images = [np.zeros((0, 3))]
    for _, symmetry in symmetries:
        if isinstance(symmetry, RotationSymmetry):
            images.append(symmetry.turn(region.points, COMPLETING_TURNS).reshape(-1, 3))
        else:
            images.append(symmetry.counterpart(region.points))
    points = np.concatenate(images)
    points = points[voxel_downsample(points, resolution)]
    return points[in_observed_frustum(points, scene)]
