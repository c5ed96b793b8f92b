"""Mirror planes of the points of one view: iterated closest points, scores and duplicates.

Camera frame, metres. Constants are from the method's released program, unless noted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pipelines.array_types import Array, Indices
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.symmetry_icp.surface import OCCLUSION_POWER, FreeSpace, SeenSurface, ramp
from pipelines.geometry.transforms import basis_from_direction, unit

DIVISIONS = 5  # of the half circle, along the equator of the starts and above the equator
VOXEL_SHARE, MIN_VOXEL = 0.016, 0.002  # of the region's diagonal; metres
MAX_QUERIES = 500  # points mirrored onto all points in a round; added here, for speed
SHIFTS = 2  # added here, at the refined normal: planes slide on flat faces
ROUNDS, STEPS = 20, 3  # of closest points; of Levenberg-Marquardt in each round
MIN_PAIRS = 4  # fewer pairs determine no plane; chosen by eye
MIN_APART = 4  # voxels between a point and its counterpart
MAX_PAIR_COSINE = np.cos(np.radians(45.0))  # of the normals of a pair
# Cosines equal to this precision are ties: on a flat face, all pairs of a point are best.
SAME_DECIMALS = 3
DAMPING = (1e-6, 1e-3, 1.0)  # of a step, relative; the next value if a step does not improve
# Least squared gradient of a pair: unknowns that pairs hardly determine do not change.
FLOOR = np.array([1e-5, 1e-5, 1e-2])  # of two turns, and of the shift
STEP_ANGLE, STEP_SHIFT = np.radians(0.05), 1e-4  # radians and metres that end the rounds
NEAR = 0.01  # metres from the cloud within which images are compared
FULL_INLIER, OUTLIER = 15.0, 20.0  # degrees between normals of an inlier, and of an outlier
THIN = 135.0  # degrees from which the image is on the back of a thin wall
MIN_CLOUD_SCORE, MIN_PAIR_SCORE, MAX_OCCLUSION = 0.3, 0.8, 0.01
SAME_COSINE, SAME_SHIFT = np.cos(np.radians(7.0)), 0.01  # of duplicates; metres


@dataclass(frozen=True)
class PlaneFit:
    """A mirror plane and its scores, shares 0 to 1.

    Attributes:
        symmetry: through the point nearest to the cloud's mean.
        cloud: share of all points whose image meets the surface with the right normal.
        pairs: share of the images near the surface that do so.
        occlusion: degree to which images are in free space; 0 for none.
    """

    symmetry: ReflectionSymmetry
    cloud: float
    pairs: float
    occlusion: float

    @property
    def confidence(self) -> float:
        """Order of planes for average precision; the published method only filters."""
        return self.cloud * self.pairs * (1.0 - self.occlusion) ** OCCLUSION_POWER

    @property
    def is_accepted(self) -> bool:
        """Whether the plane passes the published thresholds."""
        is_seen = self.cloud >= MIN_CLOUD_SCORE and self.pairs >= MIN_PAIR_SCORE
        return is_seen and self.occlusion <= MAX_OCCLUSION


def plane_fits(surface: SeenSurface, space: FreeSpace) -> list[PlaneFit]:
    """Return the mirror planes of `surface` within `space`, the most confident first."""
    extent = np.ptp(surface.points, axis=0)
    voxel = max(VOXEL_SHARE * float(np.linalg.norm(extent)), MIN_VOXEL)
    thin = surface.thinned(voxel)
    search = _PlaneSearch(thin, voxel, cKDTree(thin.points), thin.points.mean(axis=0))
    planes = filter(None, map(search.refined, _starting_normals(thin.points)))
    fits = _without_duplicates([search.scored(plane, space) for plane in planes])
    return sorted(fits, key=lambda fit: -fit.confidence)


def _starting_normals(points: Array) -> Array:
    """Return (25, 3) unit normals over the hemisphere about the principal axes of `points`."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    step = np.pi / DIVISIONS
    around, up = np.meshgrid(step * np.arange(DIVISIONS), step * np.arange(DIVISIONS))
    local = [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
    return np.asarray(np.stack(local, axis=-1).reshape(-1, 3) @ axes)


@dataclass(frozen=True)
class _PlaneSearch:
    """Points that the planes n . (x - mean) = offset of one region are fitted to."""

    surface: SeenSurface
    voxel: float
    tree: cKDTree
    mean: Array

    def refined(self, start: Array) -> ReflectionSymmetry | None:
        """Return the plane refined from the plane through the mean with normal `start` (3,).

        None if there are too few pairs.
        """
        normal, offset = start, 0.0
        for _ in range(SHIFTS):
            found = self._brought_to_rest(normal, self._shift(normal))
            if found is None:
                return None
            normal, offset = found
        return ReflectionSymmetry(normal, self.mean + offset * normal)

    def _brought_to_rest(self, normal: Array, offset: float) -> tuple[Array, float] | None:
        """Return normal and offset after rounds of closest points; None with too few pairs."""
        for _ in range(ROUNDS):
            moved, met = self._pairs(normal, offset)
            if len(moved) < MIN_PAIRS:
                return None
            before = normal, offset
            normal, offset = self._stepped(moved, met, normal, offset)
            turn = np.arccos(min(1.0, float(normal @ before[0])))
            if turn < STEP_ANGLE and abs(offset - before[1]) < STEP_SHIFT:
                break
        return normal, offset

    def _shift(self, normal: Array) -> float:
        """Return the median offset of midpoints between opposite points along `normal`."""
        points, normals = self.surface.points - self.mean, self.surface.normals
        flat = points @ basis_from_direction(normal)[:, 1:]
        pairs = cKDTree(flat).query_pairs(0.5 * self.voxel, output_type="ndarray")
        along = points @ normal
        pairs = pairs[np.abs(along[pairs[:, 0]] - along[pairs[:, 1]]) >= MIN_APART * self.voxel]
        mirrored = ReflectionSymmetry(normal, self.mean).mirror_vectors(normals)
        first, second = np.concatenate([pairs, pairs[:, ::-1]]).T
        cosine = np.einsum("ni,ni->n", mirrored[first], normals[second])
        cosine = np.round(cosine, SAME_DECIMALS)
        best = np.full(len(points), MAX_PAIR_COSINE)
        np.maximum.at(best, first, cosine)
        chosen = cosine >= best[first]
        if not chosen.any():
            return 0.0
        return float(np.median(0.5 * (along[first[chosen]] + along[second[chosen]])))

    def _pairs(self, normal: Array, offset: float) -> tuple[Indices, Indices]:
        """Return the points that are mirrored and the points that their images meet."""
        plane = ReflectionSymmetry(normal, self.mean + offset * normal)
        points, normals = self.surface.points, self.surface.normals
        some = strided_at_least(np.arange(len(points)), MAX_QUERIES)
        away, met = self._nearest(plane.counterpart(points[some]), self.voxel)
        hit = np.flatnonzero(np.isfinite(away))
        moved, met, away = some[hit], met[hit], away[hit]
        cosine = np.einsum("ni,ni->n", plane.mirror_vectors(normals[moved]), normals[met])
        apart = np.linalg.norm(points[moved] - points[met], axis=1)
        good = (cosine >= MAX_PAIR_COSINE) & (apart >= MIN_APART * self.voxel)
        order = np.flatnonzero(good)[np.argsort(away[good], kind="stable")]
        nearest = order[np.unique(met[order], return_index=True)[1]]
        return moved[nearest], met[nearest]

    def _nearest(self, queries: Array, within: float) -> tuple[Array, Indices]:
        """Return distance and index (n,) of the point nearest to `queries`; inf without one."""
        away, met = self.tree.query(queries, distance_upper_bound=within)
        return np.asarray(away), np.asarray(met)

    def _stepped(
        self, moved: Indices, met: Indices, normal: Array, offset: float
    ) -> tuple[Array, float]:
        """Return normal and offset after Levenberg-Marquardt steps for the given pairs."""
        q, p = (self.surface.points[each] - self.mean for each in (moved, met))
        n_q = self.surface.normals[moved]
        for _ in range(STEPS):
            basis = basis_from_direction(normal)[:, 1:]
            r, gradient = _residuals(q, p, n_q, normal, offset)
            jacobian = np.column_stack([gradient @ basis, 2 * n_q @ normal])
            square, slope = jacobian.T @ jacobian, jacobian.T @ r
            for damping in DAMPING:
                lift = np.diag(damping * np.diag(square) + FLOOR * len(r))
                step = -np.linalg.solve(square + lift, slope)
                turned, shifted = unit(normal + basis @ step[:2]), offset + float(step[2])
                if (_residuals(q, p, n_q, turned, shifted)[0] ** 2).sum() <= (r**2).sum():
                    normal, offset = turned, shifted
                    break
        return normal, offset

    def scored(self, plane: ReflectionSymmetry, space: FreeSpace) -> PlaneFit:
        """Return `plane` with its scores."""
        points, normals = self.surface.points, self.surface.normals
        images = plane.counterpart(points)
        away, met = self._nearest(images, NEAR)
        hit = np.isfinite(away)
        turned = plane.mirror_vectors(normals[hit])
        cosine = np.einsum("ni,ni->n", turned, normals[met[hit]])
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        angle = np.where(angle > THIN, 180.0 - angle, angle)
        inliers = float((1.0 - ramp(angle, FULL_INLIER, OUTLIER)).sum())
        occlusion = float(space.occupancy_error(images).mean())
        return PlaneFit(plane, inliers / len(points), inliers / max(int(hit.sum()), 1), occlusion)


def _residuals(q: Array, p: Array, n_q: Array, normal: Array, offset: float) -> tuple[Array, Array]:
    """Return the distances (m,) of `p` from the tangent planes at the images of `q`.

    All inputs are (m, 3), relative to the mean. The gradient (m, 3) is by the normal.
    """
    c, height = n_q @ normal, p @ normal - offset
    r = np.einsum("ni,ni->n", p - q, n_q) - 2 * c * height
    return r, -2 * (n_q * height[:, None] + c[:, None] * p)


def _without_duplicates(fits: Sequence[PlaneFit]) -> list[PlaneFit]:
    """Return the fit of least occlusion of each group of alike fits, largest groups first."""
    if not fits:
        return []
    normal = np.array([fit.symmetry.normal for fit in fits])
    point = np.array([fit.symmetry.point for fit in fits])
    alike = np.abs(normal @ normal.T) > SAME_COSINE
    alike &= np.linalg.norm(point[:, None] - point, axis=-1) < SAME_SHIFT
    left, kept = set(range(len(fits))), []
    while left:
        group = _largest_clique(set(), left, alike)
        kept.append(min((fits[i] for i in group), key=lambda f: (f.occlusion, -f.confidence)))
        left = left - group
    return kept


def _largest_clique(chosen: set[int], left: set[int], alike: Array) -> set[int]:
    """Return the largest set of `chosen` and members of `left` that are all alike."""
    best, open_ones = chosen, set(left)
    while open_ones and len(chosen) + len(open_ones) > len(best):
        first = min(open_ones)
        open_ones.remove(first)
        further = {i for i in open_ones if alike[first, i]}
        found = _largest_clique(chosen | {first}, further, alike)
        best = max(best, found, key=len)
    return best
