"""Contacts as graspnetAPI finds them: a search along each finger through a signed-distance grid.

Each finger goes from half the opening to the middle in steps of about half a spacing. At the
first sample near the surface after which the distance no longer falls, a parabola through three
samples gives the contact, and a plane through nearby probes gives its normal. The faults of
graspnetAPI are reproduced: where the distance is exactly linear, as on flat faces, there is no
parabola and no contact.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Mask
from pipelines.geometry.meshes.signed_distance import SignedDistanceGrid
from pipelines.geometry.transforms import unit
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.contacts import Contacts

NEAR = float(np.sqrt(2.0) / 2.0)  # spacings within which a sample is on the surface
SEARCHED = 1.6  # spacings; the node nearest to a sample on the surface is at a smaller distance
MIN_CURVATURE = 1e-10  # metres per spacing^2 below which graspnetAPI gives up
MAX_ROOT = 10.0  # spacings from the first of three samples
MAX_CROSSING = 1.0
PROBE_RADIUS = 1.5  # spacings
MIN_SAMPLES = 3
FINGERS_AT_A_TIME = 4000

_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), -1).reshape(-1, 3)
PROBES = PROBE_RADIUS * _CUBE / np.maximum(np.linalg.norm(_CUBE, axis=1, keepdims=True), 1.0)


def close_fingers_on_grid(
    grid: SignedDistanceGrid, grasps: GraspPoses, opening: ArrayLike
) -> Contacts:
    """Return the contacts of `grasps`, in the frame of the grid's object, metres.

    `opening`: (n,) or one number, distance of the fingers before they close. The grasps'
    `translation` is the point where the fingers would meet.
    """
    width = np.broadcast_to(np.asarray(opening, np.float64), grasps.width.shape)
    closing = unit(grasps.closing)
    way = np.stack([closing, -closing], 1).reshape(-1, 3)
    reach = np.repeat(width / 2.0, 2)
    start = np.repeat(grasps.translation, 2, axis=0) - reach[:, None] * way
    where, found = np.zeros((len(way), 3)), np.zeros(len(way), np.bool_)
    for first in range(0, len(way), FINGERS_AT_A_TIME):
        part = slice(first, first + FINGERS_AT_A_TIME)
        where[part], found[part] = _first_contact(grid, start[part], way[part], reach[part])
    both = np.asarray(found.reshape(-1, 2).all(axis=1))
    touching = np.repeat(both, 2)
    points, normals = np.full((2, *way.shape), np.nan)
    points[touching] = where[touching] * grid.spacing + grid.origin
    normals[touching] = _normals(grid, where[touching], way[touching])
    return Contacts(points.reshape(-1, 2, 3), normals.reshape(-1, 2, 3), both)


def _first_contact(
    grid: SignedDistanceGrid, start: Array, way: Array, reach: Array
) -> tuple[Array, Mask]:
    """Return the contact points (n, 3) of fingers, in spacings, and whether (n,) each touches."""
    count = np.maximum((2.0 * reach / grid.spacing).astype(np.int64), MIN_SAMPLES)[:, None]
    index = np.arange(count.max(initial=MIN_SAMPLES))
    steps = np.where(index < count - 1, index * (reach[:, None] / (count - 1)), reach[:, None])
    line = start[:, None] + steps[..., None] * way[:, None]
    # graspnetAPI's points pass through single precision on their way into the grid.
    line = (line.astype(np.float32).astype(np.float64) - grid.origin) / grid.spacing
    distance = np.where(index < count, _distances_near(grid, line), np.inf)
    size = np.abs(distance)
    rising = np.ones(size.shape, np.bool_)
    rising[:, :-1] = size[:, 1:] >= size[:, :-1]
    row, sample = np.nonzero((size < NEAR * grid.spacing) & rising & (reach[:, None] > 0.0))
    three = np.clip(sample - 1, 0, count[row, 0] - 3)[:, None] + np.arange(3)
    where = _crossings(line[row[:, None], three], distance[row[:, None], three])
    good = np.isfinite(where[:, 0])
    row, where = row[good], where[good]
    touched, earliest = np.unique(row, return_index=True)  # rows come sample by sample
    contact, found = np.zeros((len(start), 3)), np.zeros(len(start), np.bool_)
    contact[touched], found[touched] = where[earliest], True
    return contact, found


def _distances_near(grid: SignedDistanceGrid, line: Array) -> Array:
    """Return distances (n, m) at `line` (n, m, 3), spacings; inf far from the surface.

    Most of a finger's way is through the air: distances are interpolated only at samples that may
    be near the surface, and at two samples before and after them.
    """
    node = np.clip(np.rint(line), 0, np.array(grid.values.shape) - 1).astype(np.int64)
    near = np.abs(grid.values[node[..., 0], node[..., 1], node[..., 2]]) < SEARCHED * grid.spacing
    wanted = near.copy()
    for shift in (1, 2):
        wanted[:, shift:] |= near[:, :-shift]
        wanted[:, :-shift] |= near[:, shift:]
    distance = np.full(wanted.shape, np.inf)
    distance[wanted] = trilinear_distance(grid, line[wanted])
    return distance


def trilinear_distance(grid: SignedDistanceGrid, points: Array) -> Array:
    """Return the trilinear distance (...) at `points` (..., 3), in spacings from the origin."""
    last = np.array(grid.values.shape) - 1
    inside = np.clip(points, 0.0, last)
    low = np.minimum(np.floor(inside).astype(np.int64), last - 1)
    share = inside - low
    weights = (1.0 - share, share)
    total = np.zeros(points.shape[:-1])
    for x, y, z in np.ndindex(2, 2, 2):
        weight = weights[x][..., 0] * weights[y][..., 1] * weights[z][..., 2]
        total += weight * grid.values[low[..., 0] + x, low[..., 1] + y, low[..., 2] + z]
    return total


def _crossings(points: Array, distance: Array) -> Array:
    """Return the points (n, 3) where a parabola through three samples crosses zero, else nan.

    `points`: (n, 3, 3) in spacings, three samples of a line; `distance`: (n, 3) at them.
    """
    if not len(points):
        return np.zeros((0, 3))
    direction = unit(points[:, 1] - points[:, 0])
    axis = (direction != 0.0).argmax(axis=1)[:, None]  # this coordinate gives the arc lengths
    along = np.take_along_axis(direction, axis, 1)[:, 0]
    place = np.zeros((len(points), 3))
    for i in (1, 2):
        away = np.take_along_axis(points[:, i] - points[:, 0], axis, 1)[:, 0]
        place[:, i] = away / np.where(along != 0.0, along, 1.0)
    usable = np.asarray(np.isfinite(distance).all(axis=1))
    # The samples of a closed gripper coincide.
    usable &= (place[:, 1] > 0.0) & (place[:, 2] > place[:, 1])
    place[~usable] = np.arange(3)
    safe = np.where(usable[:, None], distance, 0.0)
    system = np.stack([place**2, place, np.ones_like(place)], -1)
    a, b, c = np.linalg.solve(system, safe[..., None])[..., 0].T
    usable &= np.abs(a) >= MIN_CURVATURE
    a = np.where(usable, a, 1.0)
    roots = np.linalg.eigvals(np.stack([np.stack([-b / a, -c / a], -1), [[1.0, 0.0]] * len(a)], 1))
    real = (roots.imag == 0.0) & (roots.real >= 0.0) & (roots.real <= MAX_ROOT)
    root = np.where(real[:, 1], roots[:, 1].real, roots[:, 0].real)  # the last real root
    root = np.where(real.any(axis=1), root, -b / (2.0 * a))
    usable &= np.abs(root) <= MAX_CROSSING
    return np.where(usable[:, None], points[:, 0] + root[:, None] * direction, np.nan)


def _normals(grid: SignedDistanceGrid, where: Array, way: Array) -> Array:
    """Return unit normals (n, 3) at `where` (n, 3), spacings, against the fingers' `way`.

    A plane is fitted to the probes around each contact that are on the surface.
    """
    probes = where[:, None] + PROBES
    kept = np.abs(trilinear_distance(grid, probes)) < NEAR * grid.spacing
    weight = kept / np.maximum(kept.sum(axis=1, keepdims=True), 1)
    arm = probes - np.einsum("nk,nki->ni", weight, probes)[:, None]
    normal = np.linalg.eigh(np.einsum("nk,nki,nkj->nij", weight, arm, arm))[1][:, :, 0]
    outward: Array = np.where(np.einsum("ni,ni->n", normal, way)[:, None] > 0.0, -normal, normal)
    return outward
