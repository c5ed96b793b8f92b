"""What is known of a region when its hands are judged: seen, put there by symmetry, and near."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.tabletop.levelling import UNKNOWN_UP

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

MEASURED, HIDDEN, FOREIGN = 400, 200, 150  # of a region's points that may be chosen from, each kind
HEIGHTS = (-0.05, 0.3)  # metres above the table


@dataclass(frozen=True)
class KnownRegion:
    """All that is known about a region and what is about it. Camera frame, metres.

    Attributes:
        region: n points.
        scene: that it lies in.
        slots: its symmetries.
        hidden: (h, 3) where these put points that the camera does not see.
        foreign: (f, 3) measured points nearby that are not the region's.
    """

    region: RegionCloud
    scene: SceneCloud
    slots: SymmetrySlots
    hidden: Array
    foreign: Array

    @cached_property
    def up(self) -> Array:
        """(3,) unit, away from the table."""
        return UNKNOWN_UP if self.scene.plane is None else self.scene.plane.normal

    def heights(self, points: Array) -> Array:
        """Return (...) metres of `points` (..., 3) above the table; zeros where none is known."""
        if self.scene.plane is None:
            return np.zeros(points.shape[:-1])
        return self.scene.plane.height(points)

    @cached_property
    def pool(self) -> tuple[Array, Singles]:
        """(m, 3) points to choose from, kind by kind; (m, 7) normal, kind (3), scaled height."""
        parts = [
            thinned(self.region.points, MEASURED),
            thinned(self.hidden, HIDDEN),
            thinned(self.foreign, FOREIGN),
        ]
        points = np.concatenate(parts)
        kind = np.repeat(np.eye(3), [len(part) for part in parts], axis=0)
        normals = np.zeros((len(points), 3))
        normals[: len(parts[0])] = thinned(self.region.normals, MEASURED)
        height = 10.0 * np.clip(self.heights(points), *HEIGHTS)
        return points, np.column_stack([normals, kind, height]).astype(np.float32)


def thinned(rows: Array, count: int) -> Array:
    """Return at most `count` of `rows` (n, ...), evenly spread over their order."""
    return rows[:: max(1, -(-len(rows) // count))]
