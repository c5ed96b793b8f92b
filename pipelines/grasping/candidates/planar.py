"""Planar grasps from a region's boundary, without symmetry (Sec. III-F, D. 8).

A region is seen along an approach direction and sliced at some depths behind its nearest point.
Each slice is a mask on the plane across the approach. Two points of its boundary with opposite
outward normals along the line between them are a grasp. Slices at several depths also find the
walls of hollow objects: a bowl's slice below the rim is a ring.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.transforms import basis_from_direction, unit
from pipelines.grasping.candidates.candidates import GraspCandidates
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.scene import RegionCloud, SceneCloud

SLICE_DEPTHS = (0.006, 0.013, 0.025, 0.045, 0.08)  # metres behind the nearest point
TILTS = (0.0, 0.35, 0.7, 1.0)  # shares of the way from straight into the table to the view ray
THINNEST = 0.004  # metres, least depth of a slice behind the nearest point
STEEP_APPROACH = 0.9  # cosine to the table's normal from which the table bounds the depth
MAX_BOUNDARY = 72  # boundary points per slice
MAX_PAIRS = 24  # pairs per slice
PLACE = 4.0  # cells, side of a square that holds the middle of one pair at most
MIN_HOLDING = 0.8  # cosine of the contact angle, 37 degrees: friction of rubber pads is about 0.75
ANGLES = np.radians([0.0, 20.0, -20.0, 40.0, -40.0])  # about the contact line
HIDDEN_PENALTY = 0.3  # of the confidence that a boundary facing away is the object's end
MIN_CELL, MAX_CELLS = 0.002, 120  # metres; cells along the longer side
MARGIN = 3  # empty cells about the region
EXTREMES = (0.02, 0.98)  # shares of the cells, against strays: nearest and farthest depth
SHORTEST = 4  # cells; a shorter outline is a stray
SMOOTHING = 2.0  # cells, of an outline before its normals are measured
OUTSIDE = 2.5  # cells beyond the outline where the depth below the wall is taken


@dataclass(frozen=True)
class HeightMap:
    """A region seen along `approach`: the depth of the nearest point in each cell of a grid."""

    axes: Array  # (3, 3) columns approach, and any two across, called right and down
    low: Array  # (2,) metres, corner of the grid
    cell: float
    depth: Array  # (rows, columns) metres along approach, inf where empty

    @classmethod
    def of(cls, points: Array, approach: Array) -> "HeightMap":
        """Return the map of `points` (n, 3), metres, along the unit `approach` (3,)."""
        axes = basis_from_direction(approach)
        low, cell, depth = _nearest_in_cells(points @ axes)
        measured = np.isfinite(depth).astype(np.uint8)
        # Small gaps between measured cells are closed.
        inside = cv2.morphologyEx(measured, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        depth = _filled(depth, np.asarray(inside, np.uint8))
        return cls(axes, low - MARGIN * cell, cell, depth)

    def across(self, direction: Array) -> Array:
        """Return the part (2,) of `direction` (3,) in the plane across the approach."""
        return np.asarray(direction @ self.axes[:, 1:])

    def points_at(self, pixels: Array, depth: float) -> Array:
        """Return points (n, 3), camera frame, of `pixels` (n, 2) as (column, row) at `depth`."""
        flat = self.low + (pixels + 0.5) * self.cell
        return np.asarray(flat @ self.axes[:, 1:].T + depth * self.axes[:, 0])


def planar_candidates(region: RegionCloud, feasibility: Feasibility) -> GraspCandidates:
    """Return planar grasps of `region` along the table's normal, the view ray and between."""
    contacts, stability, approaches = [np.zeros((0, 2, 3))], [np.zeros(0)], [np.zeros((0, 3))]
    for approach in approach_directions(region, feasibility.scene):
        view = HeightMap.of(region.points, approach)
        for depth, contact_depth in _slice_depths(view, region.middle, feasibility):
            pairs, held = _slice_pairs(view, depth, region, feasibility)
            contacts.append(view.points_at(pairs.reshape(-1, 2), contact_depth).reshape(-1, 2, 3))
            stability.append(held)
            approaches.append(np.broadcast_to(approach, (len(held), 3)))
    whole = np.concatenate(contacts), np.concatenate(approaches)
    return GraspCandidates.without_symmetry(*whole, ANGLES, np.concatenate(stability), "planar")


def approach_directions(region: RegionCloud, scene: SceneCloud) -> list[Array]:
    """Return unit approaches (3,): into the table, along the view ray, and between."""
    ray = region.view_ray
    if scene.inward is None:
        return [ray]
    return [unit((1.0 - share) * scene.inward + share * ray) for share in TILTS]


def _slice_depths(
    view: HeightMap, middle: Array, feasibility: Feasibility
) -> list[tuple[float, float]]:
    """Return the depths of slices, and of the contacts in each, along the approach.

    From above, the table below the region's `middle` (3,) bounds the depth of the tips. On a thin
    object the contacts may then be slightly in front of the surface, as long as the object is still
    between the tips.
    """
    gripper, config, table = feasibility.gripper, feasibility.config, feasibility.scene.plane
    seen = view.depth[np.isfinite(view.depth)]
    nearest, farthest = quantiles(seen, EXTREMES)
    deep = [d for d in SLICE_DEPTHS[1:] if d < farthest - nearest + THINNEST]
    # At least one slice: the sides beneath a flat top, seen from straight above, are invisible.
    slices = nearest + np.array([SLICE_DEPTHS[0], *deep])
    approach = view.axes[:, 0]
    slope = 0.0 if table is None else float(-approach @ table.normal)
    if table is None or slope < STEEP_APPROACH:
        return [(float(depth), float(depth)) for depth in slices]
    height = table.height(middle) - config.min_table_distance - config.body_margin
    deepest = float(middle @ approach) + height / slope - gripper.tip_reach
    lifted = {(min(d, max(deepest, nearest + THINNEST)), min(d, deepest)) for d in slices}
    reach = gripper.tip_reach - config.min_enclosed / 2
    return sorted((float(d), float(c)) for d, c in lifted if d - c <= reach)


def _slice_pairs(
    view: HeightMap, depth: float, region: RegionCloud, feasibility: Feasibility
) -> tuple[Array, Array]:
    """Return the best pairs (k, 2, 2) of a slice, cells as (column, row), and stability (k,)."""
    inside = np.asarray(cv2.medianBlur((view.depth <= depth).astype(np.uint8), 3), np.uint8)
    boundary, outward = _boundary(inside)
    if len(boundary) < 2:
        return np.zeros((0, 2, 2)), np.zeros(0)
    contact = boundary + 0.5 * outward  # from a cell's centre to its outer edge
    steep = _wall_steepness(view.depth, depth, view.cell, boundary, outward)
    ends = 1.0 - HIDDEN_PENALTY * np.maximum(outward @ view.across(region.view_ray), 0.0)
    pairs, stability = _holding_pairs(contact, outward, steep, ends, view.cell, feasibility.widths)
    best = _spread(contact, pairs, np.argsort(-stability, kind="stable"))
    return contact[pairs[best]], stability[best]


def _boundary(inside: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Return evenly chosen boundary cells (n, 2) (column, row), and outward normals (n, 2)."""
    contours, _ = cv2.findContours(inside, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    long = [contour[:, 0] for contour in contours if len(contour) > SHORTEST]
    if not long:
        return np.zeros((0, 2)), np.zeros((0, 2))
    cells = np.concatenate(long).astype(np.int64)
    cells = np.ascontiguousarray(strided_at_least(cells, MAX_BOUNDARY))
    smooth = np.asarray(cv2.GaussianBlur(inside.astype(np.float64), (0, 0), SMOOTHING), np.float64)
    return cells.astype(np.float64), -unit(_slopes(smooth, cells))


@compiled
def _nearest_in_cells(local: Array) -> tuple[Array, float, Array]:
    """Return the lowest right and down of `local` (n, 3), the cell size and a depth image.

    The depth (rows, columns) is the depth of the nearest point of each cell, inf if empty.
    """
    x0, y0, x1, y1 = local[0, 1], local[0, 2], local[0, 1], local[0, 2]
    for n in range(len(local)):
        x0, y0 = min(x0, local[n, 1]), min(y0, local[n, 2])
        x1, y1 = max(x1, local[n, 1]), max(y1, local[n, 2])
    cell = max(MIN_CELL, max(x1 - x0, y1 - y0) / MAX_CELLS)
    rows, columns = int((y1 - y0) / cell) + 1, int((x1 - x0) / cell) + 1
    depth = np.full((rows + 2 * MARGIN, columns + 2 * MARGIN), np.inf)
    for n in range(len(local)):
        row = int((local[n, 2] - y0) / cell) + MARGIN
        column = int((local[n, 1] - x0) / cell) + MARGIN
        depth[row, column] = min(depth[row, column], local[n, 0])
    return np.array((x0, y0)), cell, depth


@compiled
def _filled(depth: Array, inside: NDArray[np.uint8]) -> Array:
    """Return `depth` (h, w) with unmeasured cells `inside` set to the least depth around."""
    height, width = depth.shape
    filled = depth.copy()
    for row in range(height):
        for column in range(width):
            if inside[row, column] == 0 or depth[row, column] < np.inf:
                continue
            for i in range(max(row - 2, 0), min(row + 3, height)):
                for j in range(max(column - 2, 0), min(column + 3, width)):
                    filled[row, column] = min(filled[row, column], depth[i, j])
    return filled


@compiled
def _slopes(smooth: Array, cells: Indices) -> Array:
    """Return the gradient (n, 2) of `smooth` (h, w) at `cells` (n, 2) by Sobel's filters."""
    slopes = np.empty((len(cells), 2))
    for n in range(len(cells)):
        j, i = cells[n, 0], cells[n, 1]
        a, b = smooth[i - 1, j + 1] - smooth[i - 1, j - 1], smooth[i, j + 1] - smooth[i, j - 1]
        slopes[n, 0] = a + 2.0 * b + (smooth[i + 1, j + 1] - smooth[i + 1, j - 1])
        a, b = smooth[i + 1, j - 1] - smooth[i - 1, j - 1], smooth[i + 1, j] - smooth[i - 1, j]
        slopes[n, 1] = a + 2.0 * b + (smooth[i + 1, j + 1] - smooth[i - 1, j + 1])
    return slopes


@compiled
def _wall_steepness(depth: Array, at: float, cell: float, cells: Array, outward: Array) -> Array:
    """Return the sine (n,) between the wall below a boundary cell and the plane of the slice.

    `OUTSIDE` cells farther out the region has either ended (a wall as steep as can be seen) or is
    deeper by an amount that gives the slope. `depth`: (h, w), sliced `at` metres.
    """
    height, width = depth.shape
    steep = np.ones(len(cells))
    for n in range(len(cells)):
        column = int(np.rint(cells[n, 0] + OUTSIDE * outward[n, 0]))
        row = int(np.rint(cells[n, 1] + OUTSIDE * outward[n, 1]))
        fall = depth[min(max(row, 0), height - 1), min(max(column, 0), width - 1)] - at
        fall = (max(fall, 0.0) if fall < np.inf else 1.0) / (OUTSIDE * cell)
        steep[n] = fall / np.hypot(fall, 1.0)
    return steep


@compiled
def _holding_pairs(
    contact: Array,
    outward: Array,
    steep: Array,
    ends: Array,
    cell: float,
    widths: tuple[float, float],
) -> tuple[Indices, Array]:
    """Return the pairs (k, 2) of n boundary points that fingers hold, and their stability (k,).

    `contact` (n, 2): cells; `ends` (n,): confidence that each point is the object's end; `widths`:
    the least and the greatest distance of a pair, metres.
    """
    narrow, wide = widths
    most = len(contact) * (len(contact) - 1) // 2
    pairs, stability, count = np.empty((most, 2), np.int64), np.empty(most), 0
    for i in range(len(contact)):
        for j in range(i + 1, len(contact)):
            x, y = contact[j, 0] - contact[i, 0], contact[j, 1] - contact[i, 1]
            width = np.sqrt(x * x + y * y)
            if not narrow < width * cell < wide:
                continue
            opposed = -(x * outward[i, 0] + y * outward[i, 1])
            cosine = min(opposed, x * outward[j, 0] + y * outward[j, 1]) / width
            holding = cosine * min(steep[i], steep[j])
            if holding > MIN_HOLDING:
                pairs[count, 0], pairs[count, 1] = i, j
                stability[count] = holding * holding * min(ends[i], ends[j])
                count += 1
    return pairs[:count].copy(), stability[:count].copy()


@compiled
def _spread(contact: Array, pairs: Indices, order: Indices) -> Indices:
    """Return the first few of `pairs` (k, 2) in `order`, at most one at each place."""
    best, places = np.empty(MAX_PAIRS, np.int64), np.empty((MAX_PAIRS, 2))
    count = 0
    for n in range(len(order)):
        k = order[n]
        i, j = pairs[k, 0], pairs[k, 1]
        x = np.floor(0.5 * (contact[i, 0] + contact[j, 0]) / PLACE)
        y = np.floor(0.5 * (contact[i, 1] + contact[j, 1]) / PLACE)
        taken = False
        for other in range(count):
            taken |= (places[other, 0] == x) & (places[other, 1] == y)
        if not taken:
            best[count], places[count, 0], places[count, 1] = k, x, y
            count += 1
        if count == MAX_PAIRS:
            break
    return best[:count].copy()
