"""From per-point predictions to contact pairs (Sec. III-E, first check of Sec. III-F)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.pointcloud import voxel_downsample
from pipelines.geometry.symmetry import SPHERE_SLOT, SymmetrySlots
from pipelines.geometry.transforms import unit
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

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
    for slot in range(len(slots.existence)):
        trust = weight * existence[:, slot]
        trust = trust if trust.sum() > 0 else weight
        centre = np.array([weighted_median(point[:, slot, i], trust) for i in range(3)])
        if slot != SPHERE_SLOT:
            axis = leading_direction(direction[:, slot], trust)
            slots.direction[slot] = axis
            if slot < SPHERE_SLOT - 1:
                offset = weighted_median(point[:, slot] @ axis, trust)
                centre = centre + (offset - centre @ axis) * axis
        slots.point[slot] = centre
    return slots


def leading_direction(directions: Array, weight: Array) -> Array:
    """Return the unit axis (3,) of `directions` (n, 3), whose signs do not matter."""
    scatter = np.einsum("n,ni,nj->ij", weight, directions, directions)
    axis: Array = np.linalg.eigh(scatter)[1][:, 2]
    return axis if axis[np.abs(axis).argmax()] > 0 else -axis


def weighted_median(values: Array, weight: Array) -> float:
    """Return the smallest of `values` (n,) that half of `weight` (n,) does not exceed."""
    order = np.argsort(values)  # equal values are one value, whichever comes first
    cumulative = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(cumulative, 0.5 * cumulative[-1])])


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
    symmetries = slots.existing(config.least_trust)
    chosen = np.flatnonzero(graspable(affordance, config))
    if not symmetries or not len(chosen):
        return _no_pairs()
    points, normals = region.points[chosen], region.normals[chosen]
    images = np.stack([symmetry.counterpart(points) for _, symmetry in symmetries], 1)
    lines = unit(images - points[:, None])
    cosine = np.abs(np.einsum("nki,ni->nk", lines, normals))
    sound = cosine > np.cos(config.max_contact_angle)
    width = np.linalg.norm(images - points[:, None], axis=-1)
    sound &= (width > config.min_width) & (width < gripper.max_width)
    if scene.plane is not None:  # a hand across a steeper line would come from beneath
        sound &= np.abs(lines @ scene.plane.normal) < np.sin(config.max_approach_angle)
    sound &= in_observed_frustum(images.reshape(-1, 3), scene, config).reshape(sound.shape)
    best = np.where(sound, cosine, -1.0).argmax(axis=1)
    rows = np.arange(len(chosen))
    kept = sound[rows, best]
    pairs = ContactPairs(
        np.stack([points, images[rows, best]], 1),
        affordance[chosen],
        cosine[rows, best],
        np.array([slot for slot, _ in symmetries])[best],
    )
    return thinned(pairs[kept], config)


def thinned(pairs: ContactPairs, config: SelectionConfig) -> ContactPairs:
    """Return at most `max_pairs` pairs, best first, one a `pair_spacing` of first contacts."""
    order = np.argsort(-pairs.quality, kind="stable")
    best_first = pairs[order]
    kept = voxel_downsample(best_first.contacts[:, 0], config.pair_spacing)
    return best_first[kept[: config.max_pairs]]


def in_observed_frustum(points: Array, scene: SceneCloud, config: SelectionConfig) -> Mask:
    """Return which of `points` (n, 3) may be real, given what the camera saw (Sec. III-F, D. 6).

    A point must project into the image and lie on or behind the surface seen there, to within
    `behind_tolerance` and the sensor's noise, sideways as well as in depth; where nothing was
    measured it may be real.
    """
    pixels, result = scene.intrinsics.pixels_of(points)
    shown = np.flatnonzero(result)
    if not len(shown):
        return np.asarray(result)
    column, row = pixels[shown, 0], pixels[shown, 1]
    z = points[shown, 2]
    radius = max(1, round(config.behind_tolerance * scene.intrinsics.fx / float(np.median(z))))
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    top, left = max(int(row.min()) - radius, 0), max(int(column.min()) - radius, 0)
    seen = scene.depth[top : int(row.max()) + 1 + radius, left : int(column.max()) + 1 + radius]
    front = cv2.erode(np.where(seen > 0, seen, np.inf), kernel, borderValue=np.inf)
    surface = front[row - top, column - left]
    surface = np.where(np.isfinite(surface), surface, 0.0)
    result[shown] = z > surface - config.behind_tolerance - config.depth_noise * z**2
    return np.asarray(result)


def _no_pairs() -> ContactPairs:
    return ContactPairs(np.zeros((0, 2, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
