"""The sides of regions that the camera does not see, as far as symmetries tell them (D. 32, D. 85).

A trusted symmetry maps the seen side of a region onto its unseen one. No hand should be there:
neither one at the region itself nor one at its neighbour.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.pointcloud import voxel_downsample
from pipelines.geometry.symmetry import RotationSymmetry, Symmetry, SymmetrySlots
from pipelines.grasping.candidates.decoding import in_observed_frustum
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]

COMPLETING_TURNS = np.radians(np.arange(45.0, 360.0, 45.0))


@dataclass(frozen=True)
class Completion:
    """Where points are expected that the camera does not see. Camera frame, metres.

    Attributes:
        own: (h, 3) of a region.
        others: (m, 3) of all other regions.
    """

    own: Array
    others: Array


def completions(
    regions: Sequence[RegionCloud],
    scene: SceneCloud,
    slots: Sequence[SymmetrySlots],
    config: SelectionConfig,
) -> list[Completion]:
    """Return the completion of each region of a frame by `slots`, the symmetries of each.

    Less trust is needed to keep off a neighbour's far side than to say where the own one is.
    """
    own, beside = [], []
    for region, known in zip(regions, slots, strict=True):
        sure = _trusted(known, config.min_completion_confidence, config)
        likely = _trusted(known, config.min_neighbour_confidence, config)
        beside.append(hidden_points(region, likely, scene, config))
        same = len(sure) == len(likely)  # one bound's symmetries are among the other's
        own.append(beside[-1] if same else hidden_points(region, sure, scene, config))
    return [
        Completion(mine, np.concatenate([np.zeros((0, 3)), *beside[:index], *beside[index + 1 :]]))
        for index, mine in enumerate(own)
    ]


def hidden_points(
    region: RegionCloud, symmetries: Sequence[Symmetry], scene: SceneCloud, config: SelectionConfig
) -> Array:
    """Return (h, 3) points of `region` that `symmetries` put where nothing is seen."""
    images = [np.zeros((0, 3))]
    for symmetry in symmetries:
        if isinstance(symmetry, RotationSymmetry):
            images.append(symmetry.turn(region.points, COMPLETING_TURNS).reshape(-1, 3))
        else:
            images.append(symmetry.counterpart(region.points))
    points = np.concatenate(images)
    points = points[voxel_downsample(points, config.scene_resolution)]
    return points[in_observed_frustum(points, scene, config)]


def _trusted(slots: SymmetrySlots, bound: float, config: SelectionConfig) -> list[Symmetry]:
    return slots.to_symmetries(max(bound, config.least_confidence))
