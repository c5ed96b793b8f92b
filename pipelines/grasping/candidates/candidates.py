"""Contact pairs of a region with the approaches to try at each, before any check."""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.grasping.scene import RegionCloud, SceneCloud


@dataclass(frozen=True)
class GraspCandidates:
    """Contact pairs with a base approach each. Camera frame, metres.

    Attributes:
        contacts: (k, 2, 3).
        approach: (k, 3) unit.
        angles: (m,) radians, that turn each approach about its contact line.
        quality: (k,) 0 to 1, how well the fingers would hold there.
        affordance: (k,) predicted; 0 where nothing was predicted.
        slot: (k,) symmetry slot, -1 without symmetry.
        source: `network`, `planar` or `random`.
    """

    contacts: Array
    approach: Array
    angles: Array
    quality: Array
    affordance: Array
    slot: Indices
    source: str

    @classmethod
    def without_symmetry(
        cls, contacts: Array, approach: Array, angles: Array, quality: Array, source: str
    ) -> "GraspCandidates":
        """Return contact pairs for which nothing was predicted."""
        nothing = np.zeros(len(quality)), np.full(len(quality), -1, np.int64)
        return cls(contacts, approach, angles, quality, *nothing, source)

    @classmethod
    def none(cls, angles: Array, source: str) -> "GraspCandidates":
        """Return no contact pairs."""
        return cls.without_symmetry(
            np.zeros((0, 2, 3)), np.zeros((0, 3)), angles, np.zeros(0), source
        )

    def __len__(self) -> int:
        return len(self.quality)


def every_angle(count: int) -> Array:
    """Return (count,) evenly spaced approach angles, radians."""
    return np.linspace(0.0, 2 * np.pi, count, endpoint=False)


def base_approach(region: RegionCloud, scene: SceneCloud) -> Array:
    """Return the unit direction (3,) of approach angle 0: into the table, or along the view."""
    return region.view_ray if scene.inward is None else scene.inward
