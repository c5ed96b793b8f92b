"""A region and its surroundings for the grasp critic: seen, predicted and foreign points."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipelines.array_types import Array, Singles
from pipelines.geometry.numerics.strides import strided_at_most
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasping.scene import RegionCloud, SceneCloud

MEASURED, HIDDEN, FOREIGN = 400, 200, 150  # most points of each kind to choose from
HEIGHTS = (-0.05, 0.3)  # metres above the table


@dataclass(frozen=True)
class RegionContext:
    """A region with its surroundings, for the grasp critic. Camera frame, metres.

    Attributes:
        region: the region, n points.
        scene: the scene of the region.
        symmetries: symmetries of the region.
        hidden: (h, 3) points that the symmetries predict where the camera sees nothing.
        foreign: (f, 3) measured points nearby, outside of the region.
    """

    region: RegionCloud
    scene: SceneCloud
    symmetries: SymmetrySlots
    hidden: Array
    foreign: Array

    @cached_property
    def center(self) -> Array:
        """Expected centre of mass (3,): the middle, moved toward each symmetry (D. 143).

        The share of the distance is the confidence in the symmetry.
        """
        center = self.region.middle
        for slot, symmetry in self.symmetries.between(0.0):
            across = symmetry.counterpart(center) - center
            center = center + 0.5 * self.symmetries.probability[slot] * across
        return center

    def heights(self, points: Array) -> Array:
        """Return the height (...) of `points` (..., 3) above the table, metres, 0 without one."""
        if self.scene.plane is None:
            return np.zeros(points.shape[:-1])
        return self.scene.plane.height(points)

    @cached_property
    def pool(self) -> tuple[Array, Singles]:
        """Points (m, 3) to choose from, by kind, with (m, 7) normal, kind (3), scaled height."""
        parts = [
            strided_at_most(self.region.points, MEASURED),
            strided_at_most(self.hidden, HIDDEN),
            strided_at_most(self.foreign, FOREIGN),
        ]
        points = np.concatenate(parts)
        kind = np.repeat(np.eye(3), [len(part) for part in parts], axis=0)
        normals = np.zeros((len(points), 3))
        normals[: len(parts[0])] = strided_at_most(self.region.normals, MEASURED)
        height = 10.0 * np.clip(self.heights(points), *HEIGHTS)
        return points, np.column_stack([normals, kind, height]).astype(np.float32)
