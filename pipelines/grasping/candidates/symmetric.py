"""Contact pairs of graspable points and their counterparts under a symmetry (Sec. III-E, III-F)."""

from collections.abc import Sequence

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import CandidateConfig
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.pointcloud import voxel_downsample
from pipelines.geometry.symmetry import Symmetry
from pipelines.grasping.candidates.candidates import GraspCandidates, base_approach, every_angle
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.scene import RegionCloud
from pipelines.grasping.symmetries.observed_frustum import in_observed_frustum


def symmetric_candidates(
    region: RegionCloud,
    symmetries: Sequence[tuple[int, Symmetry]],
    affordance: Array,
    config: CandidateConfig,
    feasibility: Feasibility,
) -> GraspCandidates:
    """Return pairs of the graspable points of `region` with their counterparts.

    Of several `symmetries`, each with its slot, the one whose counterpart's normal is closest to
    antiparallel wins (D. 5): mirroring turns a normal n into n - 2 (n.m) m, so that is the largest
    |n.m|, and the same for an axis or a centre with the direction across it. `affordance`: (n,) of
    the points.
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
    """Return which of its `images` (n, k, 3) each of `points` (n, 3) is paired with, -1 for none.

    And the cosine (n,) between its normal and the line to it. `widths`: the least and greatest.
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
