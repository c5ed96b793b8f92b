"""Random antipodal pairs of a region's points: a baseline without any prediction."""

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import CandidateConfig
from pipelines.geometry.transforms import unit
from pipelines.grasping.candidates.candidates import GraspCandidates, base_approach, every_angle
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.scene import RegionCloud

DRAWS = 4000  # pairs of points
LEAST_COSINE = np.cos(0.7)  # of the angle between both normals and the line, radians


def random_candidates(
    region: RegionCloud, config: CandidateConfig, feasibility: Feasibility, rng: np.random.Generator
) -> GraspCandidates:
    """Return random pairs of the points of `region` that the gripper's width allows.

    Both normals are within 40 degrees of the line between the points, where such pairs are
    seen from one side; where none is drawn, all pairs are returned, the least bad first.
    """
    contacts = _drawn_pairs(region, feasibility.widths, config, rng)
    approach = np.broadcast_to(base_approach(region, feasibility.scene), (len(contacts), 3))
    angles = every_angle(config.num_approach_angles)
    return GraspCandidates.without_symmetry(
        contacts, approach, angles, np.ones(len(contacts)), "random"
    )


def _drawn_pairs(
    region: RegionCloud,
    widths: tuple[float, float],
    config: CandidateConfig,
    rng: np.random.Generator,
) -> Array:
    """Return (n, 2, 3) pairs of the region's points within `widths`, the least and the greatest."""
    first, second = rng.integers(0, len(region), (2, DRAWS))
    contacts = np.stack([region.points[first], region.points[second]], 1)
    line = unit(contacts[:, 1] - contacts[:, 0])
    cosine = np.minimum(
        -np.einsum("ni,ni->n", line, region.normals[first]),
        np.einsum("ni,ni->n", line, region.normals[second]),
    )
    width = np.linalg.norm(contacts[:, 1] - contacts[:, 0], axis=1)
    fits = (width >= widths[0]) & (width <= widths[1])
    chosen = np.flatnonzero(fits & (cosine > LEAST_COSINE))
    if not len(chosen):  # nothing antipodal is seen
        order = np.argsort(-cosine, kind="stable")
        chosen = order[fits[order]]
    return np.asarray(contacts[chosen[: config.max_pairs]])
