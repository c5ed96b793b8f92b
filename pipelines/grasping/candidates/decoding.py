"""From per-point predictions to contact pairs (Sec. III-E, first check of Sec. III-F)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import median
from pipelines.geometry.pointcloud import voxel_downsample
from pipelines.geometry.symmetry import REFLECTION_SLOTS, SPHERE_SLOT, SymmetrySlots
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Bounds = tuple[float, float, float, float]

FULL_EXTENT = 0.8  # of the best affordance: what counts as high where none exceeds the threshold


@dataclass(frozen=True)
class ContactPairs:
    """Where the two fingers would touch.

    Attributes:
        contacts: (k, 2, 3) metres, camera frame; the first contact is a measured point.
        affordance: (k,) of the first contact.
        alignment: (k,) cosine between the first contact's normal and the contact line.
        slot: (k,) the symmetry slot that the second contact comes from.
    """

    contacts: Array
    affordance: Array
    alignment: Array
    slot: NDArray[np.int64]

    @property
    def quality(self) -> Array:
        """(k,) 0 to 1, how well fingers would hold here, as far as is known."""
        return self.affordance * self.alignment

    def __len__(self) -> int:
        return len(self.slot)

    def __getitem__(self, index: NDArray[np.integer] | Mask) -> "ContactPairs":
        return ContactPairs(
            self.contacts[index], self.affordance[index], self.alignment[index], self.slot[index]
        )


def average_symmetries(
    existence: Array, point: Array, direction: Array, affordance: Array
) -> SymmetrySlots:
    """Average per-point predictions into one set of slots, weighed by affordance (D. 4).

    A normal and its opposite are one plane, so directions average as the leading eigenvector of
    the sum of their outer products; points as the weighted median, moved along the direction to
    the weighted median plane.

    Args:
        existence: (n, 5) probabilities.
        point: (n, 5, 3) metres.
        direction: (n, 5, 3) unit; that of the sphere is not looked at.
        affordance: (n,).
    """
    weight = np.maximum(np.asarray(affordance, np.float64), 0.0)
    weight = weight / weight.sum() if weight.sum() > 0 else np.full(len(weight), 1 / len(weight))
    slots = SymmetrySlots.empty()
    slots.existence[:] = weight @ existence
    trust = (weight[:, None] * existence).T  # (5, n)
    trust = np.where(trust.sum(axis=1, keepdims=True) > 0, trust, weight)
    points, directions = _by_slot(point), _by_slot(direction)[:SPHERE_SLOT]
    slots.point[:] = weighted_median(points, trust[:, None])
    axes = leading_directions(directions, trust[:SPHERE_SLOT])
    slots.direction[:SPHERE_SLOT] = axes
    planes = slice(len(REFLECTION_SLOTS))
    normals = axes[planes]
    along = (normals[:, None] @ points[planes])[:, 0]  # (3, n)
    offset = weighted_median(along, trust[planes])
    offset -= np.einsum("si,si->s", slots.point[planes], normals)
    slots.point[planes] += offset[:, None] * normals
    return slots


def _by_slot(vectors: Array) -> Array:
    """Return (5, 3, n) of (n, 5, 3), a coordinate in one piece."""
    flat = vectors.reshape(len(vectors), -1)
    return np.ascontiguousarray(flat.T, np.float64).reshape(*vectors.shape[1:], len(vectors))


def leading_directions(directions: Array, weight: Array) -> Array:
    """Return the unit axes (s, 3) of `directions` (s, 3, n), whose signs do not matter.

    `weight`: (s, n).
    """
    scatter = (weight[:, None] * directions) @ directions.swapaxes(1, 2)
    axes: Array = np.linalg.eigh(scatter)[1][..., 2]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1, keepdims=True), axis=1)
    return np.where(largest > 0, axes, -axes)


def weighted_median(values: Array, weight: Array) -> Array:
    """Return the smallest (...) of `values` (..., n) that half of `weight` does not exceed.

    `weight`: (..., n) too, or what spreads to that.
    """
    rows = np.ascontiguousarray(values, np.float64).reshape(-1, values.shape[-1])
    weights = np.ascontiguousarray(np.broadcast_to(weight, values.shape), np.float64)
    # Equal values are one value, whichever comes first.
    halfway = _halfway(rows, np.argsort(rows), weights.reshape(rows.shape))
    return halfway.reshape(values.shape[:-1])


def graspable(affordance: Array, config: SelectionConfig) -> Mask:
    """Return which points (n,) have high affordance (> 0.5 in Sec. III-E).

    Where no point does, those near the region's best count as high, unless that is weak (D. 27):
    an underestimate on an unusual object should not cost it its symmetric grasps.
    """
    best = float(affordance.max(initial=0.0))
    if best > config.min_affordance:
        return np.asarray(affordance > config.min_affordance)
    if best < config.weak_affordance:
        return np.zeros(len(affordance), bool)
    return np.asarray(affordance >= FULL_EXTENT * best)


def contact_pairs(
    region: RegionCloud,
    scene: SceneCloud,
    slots: SymmetrySlots,
    affordance: Array,
    gripper: Gripper,
    config: SelectionConfig,
) -> ContactPairs:
    """Pair the graspable points of `region` with their counterparts; `affordance` is (n,).

    Of several symmetries the one whose counterpart's normal is closest to antiparallel wins
    (D. 5): mirroring turns a normal n into n - 2 (n.m) m, so that is the largest |n.m|, and the
    same for an axis or a centre with the direction across it.
    """
    symmetries = slots.existing(config.least_confidence)
    chosen = np.flatnonzero(graspable(affordance, config))
    if not symmetries or not len(chosen):
        return _no_pairs()
    points, normals = region.points[chosen], region.normals[chosen]
    images = np.stack([symmetry.counterpart(points) for _, symmetry in symmetries], 1)
    real = in_observed_frustum(images.reshape(-1, 3), scene, config).reshape(images.shape[:2])
    up = np.zeros(3) if scene.plane is None else scene.plane.normal
    # A hand across a steeper line would come from beneath the table.
    steepest = float(np.sin(config.max_approach_angle))
    least, widest = float(np.cos(config.max_contact_angle)), float(gripper.max_width)
    bounds = (least, config.min_width, widest, steepest)
    best, cosine = _best_images(points, normals, images, real, up, bounds)
    kept = np.flatnonzero(best >= 0)
    pairs = ContactPairs(
        np.stack([points[kept], images[kept, best[kept]]], 1),
        affordance[chosen[kept]],
        cosine[kept],
        np.array([slot for slot, _ in symmetries])[best[kept]],
    )
    return thinned(pairs, config)


def thinned(pairs: ContactPairs, config: SelectionConfig) -> ContactPairs:
    """Return at most `max_pairs` pairs, best first, one a `pair_spacing` of first contacts."""
    order = np.argsort(-pairs.quality, kind="stable")
    kept = voxel_downsample(pairs.contacts[order, 0], config.pair_spacing)
    return pairs[order[kept[: config.max_pairs]]]


def in_observed_frustum(points: Array, scene: SceneCloud, config: SelectionConfig) -> Mask:
    """Return which of `points` (n, 3) may be real, given what the camera saw (Sec. III-F, D. 6).

    A point must project into the image and lie on or behind the surface seen there, to within
    `behind_tolerance` and the sensor's noise, sideways as well as in depth; where nothing was
    measured it may be real.
    """
    pixels, inside = scene.intrinsics.pixels_of(points)
    z = np.ascontiguousarray(points[:, 2], np.float64)
    if not inside.any():
        return inside
    reach = config.behind_tolerance * scene.intrinsics.fx / float(median(z[inside]))
    reach = min(reach, scene.intrinsics.width)  # of what touches the lens it has no bound
    noise = (config.behind_tolerance, config.depth_noise)
    return _real(z, pixels, inside, scene.depth, max(1, round(reach)), noise)


@compiled
def _halfway(values: Array, order: Indices, weight: Array) -> Array:
    """Return (m,) which of `values`, in ascending `order`, half of `weight` reaches.

    All are (m, n).
    """
    halfway = np.empty(len(values))
    for m in range(len(values)):
        total, gathered, n = 0.0, 0.0, 0
        for k in range(values.shape[1]):
            total += weight[m, order[m, k]]
        while gathered + weight[m, order[m, n]] < 0.5 * total:
            gathered += weight[m, order[m, n]]
            n += 1
        halfway[m] = values[m, order[m, n]]
    return halfway


@compiled
def _best_images(
    points: Array, normals: Array, images: Array, real: Mask, up: Array, bounds: Bounds
) -> tuple[Indices, Array]:
    """Return which of its `images` (n, k, 3) each of `points` (n, 3) is paired with, -1 for none.

    And the cosine (n,) between its normal and the line to it. `bounds`: the least cosine, the
    least and greatest width, the greatest cosine between the line and `up` (3,).
    """
    least, narrow, wide, steepest = bounds
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
            level = abs(x * up[0] + y * up[1] + z * up[2]) < steepest
            if level and facing > max(least, cosine[n]):
                best[n], cosine[n] = k, facing
    return best, cosine


@compiled
def _real(
    z: Array, pixels: Indices, inside: Mask, depth: Array, radius: int, noise: tuple[float, float]
) -> Mask:
    """Return which points, `z` (n,) away, something measured within `radius` pixels may hide.

    Or near which nothing was measured. `noise`: the tolerance, and what grows with z^2.
    """
    height, width = depth.shape
    real = inside.copy()
    for n in range(len(z)):
        if not inside[n]:
            continue
        column, row = pixels[n, 0], pixels[n, 1]
        farthest = z[n] + noise[0] + noise[1] * (z[n] * z[n])
        if 0 < depth[row, column] < farthest:
            continue
        measured, before = 0, 0
        left, right = max(column - radius, 0), min(column + radius + 1, width)
        for i in range(max(row - radius, 0), min(row + radius + 1, height)):
            for j in range(left, right):
                measured += depth[i, j] > 0
                before += (depth[i, j] > 0) & (depth[i, j] < farthest)
            if before:
                break
        real[n] = before > 0 or measured == 0
    return real


def _no_pairs() -> ContactPairs:
    return ContactPairs(np.zeros((0, 2, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
