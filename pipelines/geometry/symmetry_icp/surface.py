"""Thinned points of one view with normals, and the free space about them; camera frame, metres."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates
from scipy.spatial import cKDTree

from pipelines.array_types import Array, Mask
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.point_cells import cell_keys
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import basis_from_direction, unit

CELL = 0.005  # metres, edge of a cell of the distance field
REACH = 0.15  # metres about the region that the field covers
FREE_MARGIN = 0.01  # metres before a measured surface, where a cell is not yet free
MIN_FREE, MAX_FREE = 0.01, 0.03  # metres from the nearest obstacle: not, and fully, in free space
RIM = 0.01  # metres from the cloud's edge within which points are left out
RIM_NEIGHBORS = 20
RIM_GAP = np.pi / 2  # angle without a neighbour at a point of the edge
MIN_MEAN_NORMAL = 0.1  # length of a mean normal; two sides of a sheet have no common one
OCCLUSION_POWER = 10  # of the free share in the confidence of a fit; added here


@dataclass(frozen=True)
class SeenSurface:
    """Surface `points` (n, 3), metres, and their unit `normals` (n, 3) toward the camera."""

    points: Array
    normals: Array

    def thinned(self, size: float) -> "SeenSurface":
        """Return the mean point and normal of each cube of edge `size` metres."""
        _, place = np.unique(cell_keys(self.points, size), return_inverse=True)
        count = np.bincount(place)[:, None]
        points, normals = (
            np.stack([np.bincount(place, axis) for axis in each.T], axis=1) / count
            for each in (self.points, self.normals)
        )
        sound = np.linalg.norm(normals, axis=1) > MIN_MEAN_NORMAL
        return SeenSurface(points[sound], unit(normals[sound]))

    def without_rim(self) -> "SeenSurface":
        """Return the points farther than `RIM` from the edge of the cloud."""
        rim = self._rim()
        if not rim.any():
            return self
        inner = np.asarray(cKDTree(self.points[rim]).query(self.points)[0]) > RIM
        return SeenSurface(self.points[inner], self.normals[inner])

    def _rim(self) -> Mask:
        """Return a mask (n,) of points with neighbours on one side only, in the tangent plane."""
        count = min(RIM_NEIGHBORS, len(self) - 1)
        if count < 2:
            return np.ones(len(self), bool)
        near = np.asarray(cKDTree(self.points).query(self.points, count + 1)[1])[:, 1:]
        basis = basis_from_direction(self.normals)[..., 1:]
        flat = np.einsum("nki,nij->nkj", self.points[near] - self.points[:, None], basis)
        return largest_gaps(np.arctan2(flat[..., 1], flat[..., 0])) > RIM_GAP

    def __len__(self) -> int:
        return len(self.points)


def largest_gaps(angles: Array) -> Array:
    """Return the largest angle (...) between neighbours among `angles` (..., n), radians."""
    around = np.sort(angles, axis=-1)
    closed = np.concatenate([around, around[..., :1] + 2 * np.pi], axis=-1)
    return np.asarray(np.diff(closed, axis=-1).max(axis=-1))


@dataclass(frozen=True)
class FreeSpace:
    """Distance to the nearest obstacle in the space that the camera saw to be free.

    Attributes:
        low: (3,) centre of the first cell.
        distance: (x, y, z) metres at the centres of cells of edge `CELL`.
        table: the support plane, normal up; None if unknown.
    """

    low: Array
    distance: Array
    table: Plane | None

    @classmethod
    def around(
        cls, points: Array, depth: Array, intrinsics: Intrinsics, table: Plane | None = None
    ) -> "FreeSpace":
        """Return the free space about `points` (n, 3), given `depth` (H, W), 0 where missing.

        A cell is free if a measured surface is more than `FREE_MARGIN` behind its centre. All other
        cells, also cells without a measurement behind them, are obstacles.
        """
        low = points.min(axis=0) - REACH
        size = np.ceil((points.max(axis=0) + REACH - low) / CELL).astype(int) + 1
        grid = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1)
        centers = (low + CELL * grid).reshape(-1, 3)
        pixels, inside = intrinsics.pixels_of(centers)
        free = np.zeros(len(centers), bool)
        columns, rows = pixels[inside].T
        free[inside] = depth[rows, columns] > centers[inside, 2] + FREE_MARGIN
        distance = CELL * distance_transform_edt(free.reshape(size))
        return cls(low, np.minimum(distance, MAX_FREE), table)

    def occupancy_error(self, points: Array) -> Array:
        """Return (...) the error of `points` (..., 3): 0 if possible, 1 if in free space.

        Depth below the table counts as distance into free space.
        """
        places = np.moveaxis((points - self.low) / CELL, -1, 0)
        distance = map_coordinates(self.distance, places, order=1, mode="constant")
        if self.table is not None:
            distance = np.maximum(distance, -self.table.height(points))
        return ramp(distance, MIN_FREE, MAX_FREE)


def ramp(values: Array, low: float, high: float) -> Array:
    """Return (...) 0 for `values` (...) up to `low`, 1 from `high` on, and linearly between."""
    return np.clip((values - low) / (high - low), 0.0, 1.0)
