"""Planar grasps from a region's boundary: the fallback without symmetry (Sec. III-F, D. 8).

A region is looked at along an approach direction and sliced at some depths behind its nearest
point. Each slice is a mask on the plane across the approach; two points of its boundary whose
outward normals oppose each other along the line between them are a grasp. Slicing at several
depths finds the walls of hollow things as well: a bowl's slice below the rim is a ring.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.transforms import basis_from_direction, unit
from pipelines.grasping.candidates import Candidates, no_candidates
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]

SLICE_DEPTHS = (0.006, 0.013, 0.025, 0.045, 0.08)  # metres behind the nearest point
TILTS = (0.0, 0.35, 0.7, 1.0)  # shares of the way from the table's normal to the view ray
THINNEST = 0.004  # metres that a slice lies behind the nearest point at least
STEEP_APPROACH = 0.9  # cosine to the table's normal from which the table bounds the depth
MIN_CELL, MAX_CELLS = 0.002, 120  # metres; cells along a slice's longer side
MAX_BOUNDARY = 72  # boundary points a slice
MAX_PAIRS = 24  # pairs a slice
MIN_HOLDING = 0.8  # cosine of the contact angle; rubber pads slip at about 0.75, 37 degrees
COVERED = 0.4  # share of trust left to a boundary that something nearer makes
OCCLUSION_STEP = 0.008  # metres by which it is nearer
HIDDEN_PENALTY = 0.3  # a boundary that faces away from the camera may not be the object's end


@dataclass(frozen=True)
class _HeightMap:
    """A region seen along `approach`: the nearest point of each cell."""

    axes: Array  # (3, 3) columns approach, right, down
    low: Array  # (2,) metres, corner of the grid
    cell: float
    depth: Array  # (rows, columns) metres along approach, inf where empty

    @classmethod
    def of(cls, points: Array, approach: Array) -> "_HeightMap":
        axes = basis_from_direction(approach)
        local = points @ axes
        low, high = local[:, 1:].min(axis=0), local[:, 1:].max(axis=0)
        cell = max(MIN_CELL, float((high - low).max()) / MAX_CELLS)
        index = ((local[:, 1:] - low) / cell).astype(int) + 3
        depth = np.full(index.max(axis=0)[::-1] + 4, np.inf)
        np.minimum.at(depth, (index[:, 1], index[:, 0]), local[:, 0])
        return cls(axes, low - 3 * cell, cell, _holes_filled(depth))

    def across(self, direction: Array) -> Array:
        """Return (2,) the part of `direction` (3,) on the plane across the approach."""
        return np.asarray(direction @ self.axes[:, 1:])

    def points_at(self, pixels: Array, depth: float) -> Array:
        """Return (n, 3) camera-frame points of `pixels` (n, 2) as (column, row) at `depth`."""
        flat = self.low + (pixels + 0.5) * self.cell
        return np.column_stack([np.full(len(flat), depth), flat]) @ self.axes.T


def planar_candidates(
    region: RegionCloud, scene: SceneCloud, gripper: Gripper, config: SelectionConfig
) -> Candidates:
    """Return boundary grasps of `region` along the table's normal, the view ray and between."""
    parts = []
    for approach in approach_directions(region, scene):
        view = _HeightMap.of(region.points, approach)
        for depth, contact_depth in _slice_depths(view, scene, gripper, config):
            found = _slice_pairs(view, depth, contact_depth, region, scene, gripper, config)
            parts.append((*found, approach))
    if not parts:
        return no_candidates("planar")
    contacts = np.concatenate([part[0] for part in parts])
    quality = np.concatenate([part[1] for part in parts])
    approach = np.concatenate([np.broadcast_to(part[2], (len(part[1]), 3)) for part in parts])
    return Candidates(
        contacts,
        approach,
        quality,
        np.zeros(len(quality)),
        np.full(len(quality), -1, np.int64),
        "planar",
    )


def approach_directions(region: RegionCloud, scene: SceneCloud) -> list[Array]:
    """Return unit approaches (3,): into the table, along the view ray, and between."""
    ray = region.view_ray
    if scene.inward is None:
        return [ray]
    return [unit((1.0 - share) * scene.inward + share * ray) for share in TILTS]


def _slice_depths(
    view: _HeightMap, scene: SceneCloud, gripper: Gripper, config: SelectionConfig
) -> list[tuple[float, float]]:
    """Return where to slice, and how deep the contacts then are, along the approach.

    From above, the table bounds the depth of the tips. On a thin object the contacts may lie a
    little before its surface then, as long as it is still between the tips.
    """
    seen = view.depth[np.isfinite(view.depth)]
    nearest, farthest = np.percentile(seen, [2, 98])
    slices = nearest + np.array([d for d in SLICE_DEPTHS if d < farthest - nearest + THINNEST])
    slope = 0.0 if scene.plane is None else float(-view.axes[:, 0] @ scene.plane.normal)
    if scene.plane is None or slope < STEEP_APPROACH:
        return [(float(depth), float(depth)) for depth in slices]
    deepest = scene.plane.offset / slope - config.min_table_distance - config.body_margin
    deepest -= gripper.tip_reach
    lifted = {(min(d, max(deepest, nearest + THINNEST)), min(d, deepest)) for d in slices}
    reach = gripper.tip_reach - config.min_enclosed / 2
    return sorted((float(d), float(c)) for d, c in lifted if d - c <= reach)


def _holes_filled(depth: Array) -> Array:
    """Return `depth` with small gaps between measured cells closed."""
    kernel = np.ones((3, 3), np.uint8)
    inside = cv2.morphologyEx(np.isfinite(depth).astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    near = cv2.erode(depth, np.ones((5, 5), np.uint8), borderValue=np.inf)
    return np.where(np.isfinite(depth) | (inside == 0), depth, near)


def _slice_pairs(
    view: _HeightMap,
    depth: float,
    contact_depth: float,
    region: RegionCloud,
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
) -> tuple[Array, Array]:
    """Return contacts (k, 2, 3) and quality (k,) of the best pairs of one slice."""
    inside = np.asarray(cv2.medianBlur((view.depth <= depth).astype(np.uint8), 3), np.uint8)
    boundary, outward = _boundary(inside)
    if len(boundary) < 2:
        return np.zeros((0, 2, 3)), np.zeros(0)
    contact = boundary + 0.5 * outward  # from a cell's centre to its outer edge
    # Two thirds of all pairs are too far apart for the hand: these are left out first.
    first, second = _pairs_of(len(contact))
    line = contact[second] - contact[first]
    width = np.sqrt(line[:, 0] ** 2 + line[:, 1] ** 2)
    fits = (width * view.cell > config.min_width) & (width * view.cell < gripper.max_width)
    first, second = first[fits], second[fits]
    line = line[fits] / np.maximum(width[fits], 1e-9)[:, None]
    cosine = np.minimum(-_dot(line, outward[first]), _dot(line, outward[second]))
    steep = _wall_steepness(view, depth, boundary, outward)
    holding = cosine * np.minimum(steep[first], steep[second])
    kept = holding > MIN_HOLDING
    first, second, holding = first[kept], second[kept], holding[kept]
    trust = 1.0 - HIDDEN_PENALTY * np.maximum(_dot(outward, view.across(region.view_ray)), 0.0)
    trust[_covered(view.points_at(boundary + 2.0 * outward, depth), region, scene)] *= COVERED
    quality = holding**2 * np.minimum(trust[first], trust[second])
    best = _spread(0.5 * (contact[first] + contact[second]), quality)
    contacts = np.stack(
        [view.points_at(contact[index[best]], contact_depth) for index in (first, second)], axis=1
    )
    return contacts, quality[best]


@lru_cache(maxsize=2 * MAX_BOUNDARY)
def _pairs_of(count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return all pairs of two of `count` things, the first before the second."""
    first, second = np.triu_indices(count, 1)
    return first, second


def _dot(first: Array, second: Array) -> Array:
    """Return (n,) the products of (n, 2) and (n, 2) or (2,)."""
    return np.asarray(first[:, 0] * second[..., 0] + first[:, 1] * second[..., 1])


def _boundary(inside: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Return boundary cells (n, 2) as (column, row), evenly taken, and outward normals (n, 2)."""
    contours, _ = cv2.findContours(inside, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    long = [contour[:, 0] for contour in contours if len(contour) > 4]
    if not long:
        return np.zeros((0, 2)), np.zeros((0, 2))
    cells = np.concatenate(long)
    cells = cells[:: max(1, len(cells) // MAX_BOUNDARY)]
    smooth = cv2.GaussianBlur(inside.astype(np.float64), (0, 0), 2.0)
    column, row = cells.T
    slope = np.stack(
        [cv2.Sobel(smooth, cv2.CV_64F, 1, 0)[row, column],
         cv2.Sobel(smooth, cv2.CV_64F, 0, 1)[row, column]], 1
    )  # fmt: skip
    return cells.astype(np.float64), -unit(slope)


def _wall_steepness(view: _HeightMap, depth: float, cells: Array, outward: Array) -> Array:
    """Return (n,) the sine between the wall below a boundary cell and the plane of the slice.

    Two cells farther out the region is either gone (a wall as steep as can be seen) or has
    fallen away by so much.
    """
    limit = np.array(view.depth.shape[::-1]) - 1
    outer = np.clip(np.round(cells + 2.5 * outward), 0, limit).astype(int)
    fall = view.depth[outer[:, 1], outer[:, 0]] - depth
    fall = np.where(np.isfinite(fall), np.maximum(fall, 0.0), 1.0) / (2.5 * view.cell)
    return np.asarray(fall / np.hypot(fall, 1.0))


def _covered(points: Array, region: RegionCloud, scene: SceneCloud) -> NDArray[np.bool_]:
    """Return which of `points` (n, 3) another thing hides: the region may go on behind it."""
    pixels = np.round(scene.intrinsics.project(points)).astype(int)
    limit = np.array(scene.depth.shape[::-1]) - 1
    u, v = np.clip(pixels, 0, limit).T
    seen = scene.depth[v, u]
    nearer = (seen > 0) & (seen < points[:, 2] - OCCLUSION_STEP) & ~region.mask[v, u]
    return np.asarray(nearer)


def _spread(middle: Array, quality: Array) -> NDArray[np.int64]:
    """Return the indices of the best pairs, at most a few about one place. `middle`: (n, 2)."""
    order = np.argsort(-quality, kind="stable")
    place = np.floor(middle[order] / 4.0).astype(int)
    key = place[:, 0] * 100_000 + place[:, 1]
    _, first = np.unique(key, return_index=True)
    return order[np.sort(first)[:MAX_PAIRS]]
