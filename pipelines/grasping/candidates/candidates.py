"""Contact pairs of a region with the approaches to try at each, before any check.

Pairs are graspable points with their counterparts under a symmetry (Sec. III-E, III-F), or random
antipodal pairs, a baseline without any prediction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import CandidateConfig
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.pointcloud import voxel_downsample
from pipelines.geometry.symmetry import Symmetry
from pipelines.geometry.transforms import unit
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.observed_frustum import in_observed_frustum

DRAWS = 4000  # random pairs of points
LEAST_COSINE = np.cos(0.7)  # 0.7 rad, 40 degrees, between both normals and the line


@dataclass(frozen=True)
class GraspCandidates:
    """Contact pairs with a base approach each. Camera frame, metres.

    Attributes:
        contacts: (k, 2, 3).
        approach: (k, 3) unit.
        angles: (m,) radians, turns of each approach about its contact line.
        stability: (k,) 0 to 1, without the nearness to the region's middle.
        affordance: (k,) predicted; 0 without a prediction.
        slot: (k,) symmetry slot, -1 without symmetry.
        source: `network`, `planar` or `random`.
    """

    contacts: Array
    approach: Array
    angles: Array
    stability: Array
    affordance: Array
    slot: Indices
    source: str

    @classmethod
    def without_symmetry(
        cls, contacts: Array, approach: Array, angles: Array, stability: Array, source: str
    ) -> "GraspCandidates":
        """Return contact pairs without predictions; arguments as the attributes."""
        nothing = np.zeros(len(stability)), np.full(len(stability), -1, np.int64)
        return cls(contacts, approach, angles, stability, *nothing, source)

    @classmethod
    def none(cls, angles: Array, source: str) -> "GraspCandidates":
        """Return no contact pairs."""
        pairs, approach = np.zeros((0, 2, 3)), np.zeros((0, 3))
        return cls.without_symmetry(pairs, approach, angles, np.zeros(0), source)

    def __len__(self) -> int:
        return len(self.stability)


def every_angle(count: int) -> Array:
    """Return (count,) evenly spaced approach angles, radians."""
    return np.linspace(0.0, 2 * np.pi, count, endpoint=False)


def base_approach(region: RegionCloud, scene: SceneCloud) -> Array:
    """Return the unit direction (3,) of approach angle 0: into the table, or along the view."""
    return region.view_ray if scene.inward is None else scene.inward


def symmetric_candidates(
    region: RegionCloud,
    symmetries: Sequence[tuple[int, Symmetry]],
    affordance: Array,
    config: CandidateConfig,
    feasibility: Feasibility,
) -> GraspCandidates:
    """Return pairs of the graspable points of `region` with their counterparts.

    Among several `symmetries`, each with its slot, the symmetry with the most antiparallel normal
    at the counterpart wins (D. 5). Mirroring turns a normal n into n - 2 (n.m) m, so this is the
    largest |n.m|; for an axis or a centre, m is the direction across. `affordance`: (n,) of the
    points.
    """
    scene, angles = feasibility.scene, every_angle(config.num_approach_angles)
    chosen = np.flatnonzero(affordance > config.min_affordance)
    if not symmetries or not len(chosen):
        return GraspCandidates.none(angles, "network")
    points, normals = region.points[chosen], region.normals[chosen]
    images = np.stack([symmetry.counterpart(points) for _, symmetry in symmetries], 1)
    real = in_observed_frustum(images.reshape(-1, 3), scene).reshape(images.shape[:2])
    best, cosine = _best_images(points, normals, images, real, feasibility.widths)
    kept = np.flatnonzero(best >= 0)
    kept = kept[np.argsort(-affordance[chosen[kept]] * cosine[kept], kind="stable")]
    kept = kept[voxel_downsample(points[kept], config.pair_spacing)[: config.max_pairs]]
    first = affordance[chosen[kept]]
    return GraspCandidates(
        np.stack([points[kept], images[kept, best[kept]]], 1),
        np.broadcast_to(base_approach(region, scene), (len(kept), 3)),
        angles,
        first * cosine[kept],
        first,
        np.array([slot for slot, _ in symmetries])[best[kept]],
        "network",
    )


@compiled
def _best_images(
    points: Array, normals: Array, images: Array, real: Mask, widths: tuple[float, float]
) -> tuple[Indices, Array]:
    """Return the index (n,) of the best image of each of `points` (n, 3), -1 for none.

    The best image has the largest cosine, without its sign, between the point's normal and the line
    to the image; also these cosines (n,), 0 for none.

    Args:
        points: metres.
        normals: (n, 3) unit.
        images: (n, k, 3) counterparts of the points under k symmetries, metres.
        real: (n, k) images that the depth does not exclude.
        widths: the least and the greatest distance of point and image, metres.
    """
    narrow, wide = widths
    best, cosine = np.full(len(points), -1, np.int64), np.zeros(len(points))
    for n in range(len(points)):
        for k in range(images.shape[1]):
            x = images[n, k, 0] - points[n, 0]
            y = images[n, k, 1] - points[n, 1]
            z = images[n, k, 2] - points[n, 2]
            width = np.sqrt(x * x + y * y + z * z)
            if not (real[n, k] and narrow < width < wide):
                continue
            x, y, z = x / width, y / width, z / width
            facing = abs(x * normals[n, 0] + y * normals[n, 1] + z * normals[n, 2])
            if facing > cosine[n]:
                best[n], cosine[n] = k, facing
    return best, cosine


def random_candidates(
    region: RegionCloud, config: CandidateConfig, feasibility: Feasibility, rng: np.random.Generator
) -> GraspCandidates:
    """Return random pairs of points of `region` within the gripper's width.

    Both normals are within 40 degrees of the line between the points, if the view shows such
    pairs; if none is drawn, all pairs are returned, the best first.
    """
    first, second = rng.integers(0, len(region), (2, DRAWS))
    contacts = np.stack([region.points[first], region.points[second]], 1)
    line = contacts[:, 1] - contacts[:, 0]
    along, width = unit(line), np.linalg.norm(line, axis=1)
    cosine = np.minimum(
        -np.einsum("ni,ni->n", along, region.normals[first]),
        np.einsum("ni,ni->n", along, region.normals[second]),
    )
    narrow, wide = feasibility.widths
    fits = (width > 0.0) & (width >= narrow) & (width <= wide)  # a point may be drawn twice
    chosen = np.flatnonzero(fits & (cosine > LEAST_COSINE))
    if not len(chosen):  # no antipodal pair is seen
        order = np.argsort(-cosine, kind="stable")
        chosen = order[fits[order]]
    contacts = contacts[chosen[: config.max_pairs]]
    approach = np.broadcast_to(base_approach(region, feasibility.scene), (len(contacts), 3))
    angles, stability = every_angle(config.num_approach_angles), np.ones(len(contacts))
    return GraspCandidates.without_symmetry(contacts, approach, angles, stability, "random")
