"""Coarse search for candidate planes and axes of symmetry of a surface.

Candidate directions are a Fibonacci half-sphere and the principal axes. A distance grid
gives the misfit of a reflection or turn, so thousands of candidates are cheap.
Normalised coordinates: origin at the surface's centroid, unit diameter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from pipelines.array_types import Array, Indices, Singles
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.directions import half_sphere_directions
from pipelines.geometry.transforms import rotation_about

Grid = Singles

GENERIC_ANGLES = tuple(np.radians([47.0, 90.0, 151.0]))  # no n-fold axis of small n fits all angles
MARGIN = 0.15  # of the diameter, around the surface


@dataclass(frozen=True)
class DistanceGrid:
    """Distances to a surface at the cells of a cubic grid, capped. Normalised coordinates."""

    values: Grid  # (k, k, k)
    origin: Array  # (3,)
    cell: float

    @classmethod
    def around(cls, points: Array, resolution: int, cap: float) -> "DistanceGrid":
        """Build the grid of dense surface samples `points` (n, 3)."""
        low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
        cell = float((high - low).max()) / resolution
        empty = np.ones((resolution,) * 3, dtype=bool)
        index = np.minimum(((points - low) / cell).astype(int), resolution - 1)
        empty[tuple(index.T)] = False
        distance = distance_transform_edt(empty).astype(np.float32) * cell
        return cls(np.minimum(distance, cap), low, cell)

    def lookup(self, points: Array) -> Grid:
        """Return the capped distances (...) at `points` (..., 3)."""
        last = self.values.shape[0] - 1
        index = np.clip((points - self.origin) / self.cell, 0, last).astype(np.int32)
        found: Grid = self.values[index[..., 0], index[..., 1], index[..., 2]]
        return found


def principal_axis_rows(points: Array) -> Array:
    """Return the principal directions (3, 3) of `points` (n, 3) as rows, longest first."""
    centered = points - points.mean(axis=0)
    axes: Array = np.linalg.eigh(centered.T @ centered)[1].T[::-1]
    return axes


def plane_candidates(
    grid: DistanceGrid, points: Array, config: AnnotateSymmetryConfig
) -> tuple[Array, Array]:
    """Return the normals (c, 3) and offsets (c,) of the best planes n.x = d, best first.

    `points`: (n, 3) surface samples. Planes off the centroid are tried as well, because a missing
    part of the object moves the centroid.
    """
    normals = _directions(points, config.plane_directions)
    offsets = np.asarray(config.plane_offsets)
    reach = points @ normals.T  # (n, c)
    score = np.empty((len(normals), len(offsets)))
    for column, offset in enumerate(offsets):
        step = 2.0 * (reach.T - offset)[..., None] * normals[:, None, :]
        score[:, column] = grid.lookup(points[None] - step).mean(axis=1)
    order = np.argsort(score, axis=None, kind="stable")
    rows, columns = np.unravel_index(order, score.shape)
    keep = distinct_candidates(
        normals[rows],
        offsets[columns],
        config.plane_candidates,
        min_angle=np.radians(config.plane_separation_deg),
        min_offset=config.plane_offset_separation,
    )
    return normals[rows[keep]], offsets[columns[keep]]


def axis_candidates(
    grid: DistanceGrid,
    points: Array,
    config: AnnotateSymmetryConfig,
    angles: Sequence[float] = GENERIC_ANGLES,
) -> Array:
    """Return the best axis directions (c, 3) through the centroid, best first.

    `points`: (n, 3) surface samples. The worst of `angles` (radians) counts: a square column fits
    at 90 degrees only.
    """
    axes = _directions(points, config.axis_directions)
    scores = []
    for angle in angles:
        turned = points[None] @ rotation_about(axes, angle).swapaxes(1, 2)
        scores.append(grid.lookup(turned).mean(axis=1))
    order = np.argsort(np.max(scores, axis=0), kind="stable")
    keep = distinct_candidates(
        axes[order],
        np.zeros(len(order)),
        config.axis_candidates,
        min_angle=np.radians(config.axis_separation_deg),
        min_offset=np.inf,
    )
    return axes[order[keep]]


def distinct_candidates(
    directions: Array, offsets: Array, limit: int, *, min_angle: float, min_offset: float
) -> Indices:
    """Return the indices (k,) of at most `limit` candidates that differ from all better candidates.

    Candidates, with `directions` (n, 3) and `offsets` (n,), come best first. Two are the same if
    their directions differ by less than `min_angle` radians and their offsets along the common
    direction by less than `min_offset`.
    """
    kept: list[int] = []
    alive = np.ones(len(directions), dtype=bool)
    cosine = np.cos(min_angle)
    while len(kept) < limit and alive.any():
        index = int(alive.argmax())
        kept.append(index)
        along = directions @ directions[index]
        near = np.abs(offsets * np.sign(along) - offsets[index]) < min_offset
        alive &= ~((np.abs(along) > cosine) & near)
        alive[index] = False
    return np.asarray(kept, dtype=np.int64)


def _directions(points: Array, count: int) -> Array:
    frame = principal_axis_rows(points)
    return np.concatenate([frame, half_sphere_directions(count) @ frame])
