"""A region as the evidence for its symmetries: seen points, the network's symmetries, the scene."""

from dataclasses import dataclass
from typing import Self

from pipelines.array_types import Array, Mask
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE

NUM_POINTS = 400  # of the region for fits; chosen by eye


@dataclass(frozen=True)
class RegionEvidence:
    """Inputs for fitting and evaluating the symmetries of a region. Camera frame, metres.

    Attributes:
        slots: the network's symmetries.
        points: (n, 3) of the region.
        normals: (n, 3) unit.
        mask: (H, W) pixels of the region.
        scene: measured points and table.
        allowed: sources of candidates to use, bits `NETWORK` and `SHAPE`.
    """

    slots: SymmetrySlots
    points: Array
    normals: Array
    mask: Mask
    scene: SceneCloud
    allowed: int = NETWORK | SHAPE

    @classmethod
    def of(
        cls,
        slots: SymmetrySlots,
        region: RegionCloud,
        scene: SceneCloud,
        allowed: int = NETWORK | SHAPE,
    ) -> Self:
        """Return the evidence of `region` in `scene`, with some of its points."""
        points = strided_at_least(region.points, NUM_POINTS).copy()
        normals = strided_at_least(region.normals, NUM_POINTS).copy()
        return cls(slots, points, normals, region.mask, scene, allowed)
