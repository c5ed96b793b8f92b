"""Features of grasps for the grasp critic: points around the gripper, and numbers (D. 82).

Points are given in the grasp frame (approach, closing, binormal): their position relative to the
two contacts, the surface normal, and their kind: measured on the region, predicted by symmetries of
the region, or measured elsewhere. The numbers describe the pose and the surface at each contact.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, auto
from functools import cached_property

import numpy as np

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.symmetry import NUM_SLOTS, ROTATION_SLOT, SPHERE_SLOT
from pipelines.geometry.transforms import unit
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.contact_patches import PATCH_FEATURES, contact_patches
from pipelines.grasping.ranking.region_context import RegionContext
from pipelines.grasping.scene import RegionCloud

# All chosen by eye; the shipped weights were trained with these values.
NUM_POINTS = 64  # points around a grasp
APPROACH_STRETCH = 1.5  # points may be farther by this factor along the approach than across
FARTHEST, DEEPEST = 0.15, 0.05  # metres, caps of coordinates, and of distances beyond a contact
LENGTH_SCALE, BEYOND_SCALE = 20.0, 50.0  # per metre, as the comments of the columns say
FINGER_BAND, BEHIND, BEYOND, BESIDE = 0.011, -0.04, 0.03, 0.01  # metres, space between the fingers


class GraspPointFeature(IntEnum):
    """Columns of the features of a point."""

    ALONG_APPROACH = 0  # 5 centimetres, as the next two
    ALONG_CLOSING = auto()
    ALONG_BINORMAL = auto()
    BEYOND_CONTACT = auto()  # 2 centimetres along closing, positive outside of the fingers
    NORMAL_APPROACH = auto()
    NORMAL_CLOSING = auto()
    NORMAL_BINORMAL = auto()
    IS_MEASURED = auto()
    IS_HIDDEN = auto()
    IS_FOREIGN = auto()
    HEIGHT = auto()  # decimetres above the table


POINT_FEATURES = tuple(each.name.lower() for each in GraspPointFeature)
POINT_COLUMNS = len(GraspPointFeature)


@dataclass(frozen=True)
class GraspFeatures:
    """Features of k feasible grasps at a region.

    Attributes:
        feasible: the grasps, with clearance and enclosed height.
        stability: (k,) stability prior.
        visible: (k,) visible fraction of the space around the finger tips.
        context: the region and its surroundings.
    """

    feasible: RankedGrasps
    stability: Array
    visible: Array
    context: RegionContext

    @cached_property
    def _local(self) -> Singles:
        """The region's pool of points (k, 3, m) in the frame of each grasp."""
        return grasp_frame(self.context.pool[0], self.feasible.grasps)

    @property
    def _half(self) -> Singles:
        """Distance (k,) from the midpoint of the contacts to a contact, metres."""
        return (0.5 * self.feasible.grasps.width).astype(np.float32)

    @cached_property
    def _between_fingers(self) -> tuple[Singles, Singles]:
        """Distances (k, m) of the pool's points from the space between the fingers, metres.

        Also the numbers (k, 2) of measured and of hidden points in this space.
        """
        starts = np.concatenate([[0], np.cumsum(self.context.pool[1][:, 3:5].sum(axis=0))])
        return _between_fingers(self._local, self._half, starts.astype(np.int64))

    @property
    def _slot_confidence(self) -> Array:
        """Confidence (k,) in the symmetry of each grasp; 0 without a symmetry."""
        slot = self.feasible.slot
        return np.where(slot >= 0, self.context.symmetries.probability[np.maximum(slot, 0)], 0.0)

    def points(self) -> Singles:
        """Return the `POINT_FEATURES` (k, 64, 11) of the points nearest to each closing gripper."""
        away = self._between_fingers[0]
        last = min(NUM_POINTS, away.shape[1]) - 1
        reach = np.ascontiguousarray(np.partition(away, last, axis=1)[:, last])
        rotation = self.feasible.grasps.rotation.astype(np.float32)
        return _nearest_rows(self._local, rotation, self._half, away, reach, self.context.pool[1])

    def candidates(self) -> Singles:
        """Return the `CANDIDATE_FEATURES` (k, 49) of the grasps."""
        columns = [values(self) for values in CANDIDATE_BLOCKS.values()]
        return np.column_stack(columns).astype(np.float32)


def _along_axes(name: str, axes: int = 3) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}" for axis in ("approach", "closing", "binormal")[:axes])


# Features that are computed together: their names, and their columns (k, names). Factors bring
# lengths in metres, and numbers of points, near one.
CANDIDATE_BLOCKS: dict[tuple[str, ...], Callable[[GraspFeatures], Array | Singles | Mask]] = {
    ("width",): lambda f: 10.0 * f.feasible.grasps.width,
    _along_axes("up"): lambda f: np.einsum(
        "kia,i->ka", f.feasible.grasps.rotation, f.context.scene.up
    ),
    _along_axes("view", 2): lambda f: np.einsum(
        "kia,ki->ka", f.feasible.grasps.rotation[..., :2], unit(f.feasible.grasps.translation)
    ),
    ("stability",): lambda f: f.stability,
    ("visible_fraction",): lambda f: f.visible,
    ("scene_clearance",): lambda f: 20.0 * f.feasible.clearance,
    ("enclosed_height",): lambda f: 30.0 * f.feasible.enclosed_height,
    ("affordance",): lambda f: f.feasible.affordance,
    ("confidence",): lambda f: f._slot_confidence,
    ("is_reflection",): lambda f: (f.feasible.slot >= 0) & (f.feasible.slot < ROTATION_SLOT),
    ("is_rotation",): lambda f: f.feasible.slot == ROTATION_SLOT,
    ("is_sphere",): lambda f: f.feasible.slot == SPHERE_SLOT,
    ("is_planar",): lambda f: f.feasible.slot < 0,
    ("height",): lambda f: 10.0 * f.context.heights(f.feasible.grasps.translation),
    ("measured_between", "hidden_between"): lambda f: f._between_fingers[1] / 50.0,
    PATCH_FEATURES: lambda f: contact_patches(f.feasible.grasps, f.context.region),
    (*_along_axes("mean"), *_along_axes("spread"), *_along_axes("middle")): lambda f: _extent(
        f.feasible.grasps, f.context.region
    ),
    tuple(f"confidence_{slot}" for slot in range(NUM_SLOTS)): lambda f: np.broadcast_to(
        f.context.symmetries.probability, (len(f.feasible), NUM_SLOTS)
    ),
}
CANDIDATE_FEATURES = tuple(name for names in CANDIDATE_BLOCKS for name in names)


def grasp_frame(points: Array, grasps: GraspPoses) -> Singles:
    """Return `points` (m, 3) in the frame of each of k grasps (k, 3, m)."""
    middle = points.mean(axis=0)  # single precision suffices near the mean
    origin = np.einsum("ki,kia->ka", grasps.translation - middle, grasps.rotation)
    about = np.ascontiguousarray((points - middle).T, np.float32)
    return _turned(about, grasps.rotation.astype(np.float32), origin.astype(np.float32))


@compiled
def _turned(points: Singles, rotation: Singles, origin: Singles) -> Singles:
    """Return `points` (3, m) turned by each `rotation` (k, 3, 3), minus `origin` (k, 3)."""
    local = np.empty((len(origin), 3, points.shape[1]), np.float32)
    for k in range(len(origin)):
        for axis in range(3):
            a, b, c = rotation[k, 0, axis], rotation[k, 1, axis], rotation[k, 2, axis]
            d = origin[k, axis]
            for m in range(points.shape[1]):
                local[k, axis, m] = a * points[0, m] + b * points[1, m] + c * points[2, m] - d
    return local


@compiled
def _between_fingers(local: Singles, half: Singles, starts: Indices) -> tuple[Singles, Singles]:
    """Return distances (k, m) of points from the space between the contacts, and counts (k, 2).

    Distances are in metres, shrunk along the approach; the counts are of measured and of hidden
    points between the fingers.

    Args:
        local: (k, 3, m) the points in the frame of each grasp.
        half: (k,) metres from the midpoint of the contacts to a contact.
        starts: (3,) first point of both kinds, and of the third kind.
    """
    away = np.empty((len(local), local.shape[2]), np.float32)
    between = np.zeros((len(local), 2), np.float32)
    shrink, band = np.float32(APPROACH_STRETCH), np.float32(FINGER_BAND)
    behind, beyond = np.float32(BEHIND), np.float32(BEYOND)
    for k in range(len(local)):
        side = half[k] + np.float32(BESIDE)
        for m in range(local.shape[2]):
            along, across = abs(local[k, 0, m]), abs(local[k, 1, m])
            aside = abs(local[k, 2, m])
            away[k, m] = max(along / shrink, aside, across - half[k])
        for kind in range(2):
            count = 0
            for m in range(starts[kind], starts[kind + 1]):
                along, across, aside = local[k, 0, m], abs(local[k, 1, m]), abs(local[k, 2, m])
                count += (aside < band) & (along < beyond) & (along > behind) & (across < side)
            between[k, kind] = count
    return away, between


@compiled
def _nearest_rows(
    local: Singles, rotation: Singles, half: Singles, away: Singles, reach: Singles, about: Singles
) -> Singles:
    """Return the features (k, 64, 11) of the 64 points least `away` (k, m), in the given order.

    If there are fewer points, they are repeated.

    Args:
        local: (k, 3, m) the points in the frame of each grasp.
        rotation: (k, 3, 3) of the grasps.
        half: (k,) metres from the midpoint of the contacts to a contact.
        away: (k, m) metres from the space between the contacts.
        reach: (k,) distance of the last of these points.
        about: (m, 7) normal (3), kind (3) and scaled height of the points.
    """
    far, deep, scale = np.float32(FARTHEST), np.float32(DEEPEST), np.float32(LENGTH_SCALE)
    rows = np.empty((len(reach), NUM_POINTS, POINT_COLUMNS), np.float32)
    for k in range(len(reach)):
        left = NUM_POINTS  # for the points at `reach`; some may be omitted
        for m in range(len(about)):
            left -= away[k, m] < reach[k]
        count = 0
        for m in range(len(about)):
            if away[k, m] > reach[k] or (away[k, m] == reach[k] and left == 0):
                continue
            left -= away[k, m] == reach[k]
            for axis in range(3):
                place = min(max(local[k, axis, m], -far), far)
                rows[k, count, GraspPointFeature.ALONG_APPROACH + axis] = scale * place
                rows[k, count, GraspPointFeature.NORMAL_APPROACH + axis] = (
                    about[m, 0] * rotation[k, 0, axis]
                    + about[m, 1] * rotation[k, 1, axis]
                    + about[m, 2] * rotation[k, 2, axis]
                )
            beyond = min(max(abs(local[k, 1, m]) - half[k], -deep), deep)
            rows[k, count, GraspPointFeature.BEYOND_CONTACT] = np.float32(BEYOND_SCALE) * beyond
            for column in range(3, 7):  # kind and height follow the normal
                rows[k, count, GraspPointFeature.IS_MEASURED + column - 3] = about[m, column]
            count += 1
        for n in range(count, NUM_POINTS):
            for column in range(POINT_COLUMNS):
                rows[k, n, column] = rows[k, n - count, column]
    return rows


def _extent(grasps: GraspPoses, region: RegionCloud) -> Array:
    """Return mean, spread and middle of the region (k, 9), in 5 centimetres, grasp frame.

    The mean is relative to the middle, the middle relative to the midpoint of the contacts.
    """
    about = region.points - region.middle
    mean = about.mean(axis=0)
    off = about - mean
    R = grasps.rotation
    spread = np.sqrt(np.maximum((R * (off.T @ off / len(off) @ R)).sum(axis=1), 0.0))
    offset = np.einsum("kia,ki->ka", R, region.middle - grasps.translation)
    turned = np.einsum("kia,i->ka", R, mean)
    return np.column_stack([LENGTH_SCALE * each for each in (turned, spread, offset)])
