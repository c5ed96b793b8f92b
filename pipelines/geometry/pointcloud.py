"""Point clouds: normals, thinning, planes. Metres, any frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from pipelines.geometry.point_cells import cell_keys, first_of_each
from pipelines.geometry.transforms import unit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plane:
    """The plane n . p + offset = 0 with unit `normal` (3,)."""

    normal: Array
    offset: float

    def height(self, points: ArrayLike) -> Array:
        """Return the signed distance (...) of `points` (..., 3), positive along the normal."""
        return np.asarray(np.asarray(points, np.float64) @ self.normal + self.offset)

    def facing(self, viewpoint: ArrayLike) -> "Plane":
        """Return the same plane with its normal pointing to the side of `viewpoint` (3,)."""
        return self if self.height(viewpoint) >= 0 else Plane(-self.normal, -self.offset)


def fit_plane(points: ArrayLike) -> Plane:
    """Return the least-squares plane of `points` (n >= 3, 3)."""
    p = np.asarray(points, np.float64)
    centre = p.mean(axis=0)
    normal = np.linalg.svd(np.cov((p - centre).T))[0][:, 2]
    return Plane(normal, float(-normal @ centre))


def fit_plane_ransac(
    points: ArrayLike,
    rng: np.random.Generator,
    *,
    tolerance: float = 0.005,
    iterations: int = 256,
    sample: int = 4000,
) -> tuple[Plane, NDArray[np.bool_]] | None:
    """Return the plane with most of `points` (n, 3) within `tolerance` metres, and those points.

    Hypotheses are counted on at most `sample` points and the best one is refitted on all.
    Returns None for fewer than 3 points or if all lie on a line.
    """
    p = np.asarray(points, np.float64)
    if len(p) < 3:
        return None
    subset = p if len(p) <= sample else p[rng.choice(len(p), sample, replace=False)]
    triples = subset[rng.integers(0, len(subset), (iterations, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals, triples = normals[lengths > 1e-9], triples[lengths > 1e-9]
    if not len(normals):
        return None
    normals = unit(normals)
    offsets = -np.einsum("ij,ij->i", normals, triples[:, 0])
    counts = (np.abs(subset @ normals.T + offsets) < tolerance).sum(axis=0)
    plane = Plane(normals[counts.argmax()], float(offsets[counts.argmax()]))
    for _ in range(3):
        inliers = np.abs(plane.height(p)) < tolerance
        if inliers.sum() < 3:
            return None
        plane = fit_plane(p[inliers])
    return plane, np.abs(plane.height(p)) < tolerance


def estimate_normals(points: ArrayLike, k: int = 16, toward: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Return unit normals (n, 3) of `points` (n, 3) from `k` neighbours, pointing to `toward`."""
    p = np.asarray(points, np.float64)
    if len(p) < 3:
        return unit(np.asarray(toward, np.float64) - p)
    _, neighbours = KDTree(p).query(p, k=min(k, len(p)))
    groups = p[neighbours] - p[neighbours].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", groups, groups))
    normals = vectors[:, :, 0]
    flip = np.einsum("ij,ij->i", normals, np.asarray(toward, np.float64) - p) < 0
    return np.where(flip[:, None], -normals, normals)


def normals_from_organized(xyz: ArrayLike, step: int = 2) -> Array:
    """Return (H, W, 3) unit normals toward the camera of an organised cloud; nan where unknown.

    Central differences over `step` pixels of `xyz` (H, W, 3), camera frame, nan where missing.
    """
    p = np.asarray(xyz, np.float64)
    across, down = np.full_like(p, np.nan), np.full_like(p, np.nan)
    across[:, step:-step] = p[:, 2 * step :] - p[:, : -2 * step]
    down[step:-step] = p[2 * step :] - p[: -2 * step]
    normals = np.cross(across, down)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = normals / np.where(length > 0, length, np.nan)
        away = np.einsum("hwi,hwi->hw", normals, p) > 0
    return np.where(away[..., None], -normals, normals)


def voxel_downsample(points: ArrayLike, size: float) -> NDArray[np.int64]:
    """Return the indices of one point a cube of edge `size` metres, in ascending order."""
    return first_of_each(cell_keys(np.asarray(points, np.float64), size))
