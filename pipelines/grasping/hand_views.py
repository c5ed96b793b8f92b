"""What a hand meets, point by point: what the judge of hands looks at (D. 82).

The points about a hand are told in its own frame (approach, closing, third): where they lie to the
two contacts, how the surface faces there, and how they are known: measured on the region, put
there by its symmetries, or measured on something else. Beside them stand numbers about the pose
and the surface at each contact.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.levelling import UNKNOWN_UP
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT, SymmetrySlots
from pipelines.geometry.transforms import unit
from pipelines.grasping.candidates import RankedGrasps
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

NUM_POINTS = 64  # about a hand that are looked at
MEASURED, HIDDEN, FOREIGN = 400, 200, 150  # of a region's points that may be among them, each kind
ALONG = 1.5  # how much farther points may lie along the approach than across
PATCHES = (0.006, 0.012)  # metres about a contact
PATCHED = 1500  # of the region's points that tell of it
CONTACT_REACH = 0.015  # metres within which the seen surface tells of a contact
FARTHEST, DEEPEST = 0.15, 0.05  # metres, of coordinates and of distances from a finger's face
HEIGHTS = (-0.05, 0.3)  # metres above the table
FINGER_BAND, BEHIND, BEYOND, BESIDE = 0.011, -0.04, 0.03, 0.01  # metres: the room between fingers
POINT_FEATURES = 11
HAND_FEATURES = 49


@dataclass(frozen=True)
class KnownRegion:
    """All that is known about a region and what is about it. Camera frame, metres.

    Attributes:
        region: n points.
        scene: that it lies in.
        slots: its symmetries.
        hidden: (h, 3) where these put points that the camera does not see.
        foreign: (f, 3) measured points nearby that are not the region's.
    """

    region: RegionCloud
    scene: SceneCloud
    slots: SymmetrySlots
    hidden: Array
    foreign: Array

    @cached_property
    def up(self) -> Array:
        """(3,) unit, away from the table."""
        return UNKNOWN_UP if self.scene.plane is None else self.scene.plane.normal

    def heights(self, points: Array) -> Array:
        """Return (...) metres of `points` (..., 3) above the table; zeros where none is known."""
        if self.scene.plane is None:
            return np.zeros(points.shape[:-1])
        return self.scene.plane.height(points)

    @cached_property
    def pool(self) -> tuple[Array, Singles]:
        """(m, 3) points to choose from; (m, 7) normal, one of three kinds, scaled height."""
        parts = [
            thinned(self.region.points, MEASURED),
            thinned(self.hidden, HIDDEN),
            thinned(self.foreign, FOREIGN),
        ]
        points = np.concatenate(parts)
        kind = np.repeat(np.eye(3), [len(part) for part in parts], axis=0)
        normals = np.zeros((len(points), 3))
        normals[: len(parts[0])] = thinned(self.region.normals, MEASURED)
        height = 10.0 * np.clip(self.heights(points), *HEIGHTS)
        return points, np.column_stack([normals, kind, height]).astype(np.float32)


def thinned(rows: Array, count: int) -> Array:
    """Return at most `count` of `rows` (n, ...), evenly spread over their order."""
    return rows[:: max(1, -(-len(rows) // count))]


@dataclass(frozen=True)
class HandViews:
    """How k hands, feasible in the selection, stand to a region.

    Attributes:
        found: the hands, with clearance and enclosed height.
        steady: (k,) of the selection.
        sight: (k,) share of the finger tips' room that is seen to be free.
        known: the region.
    """

    found: RankedGrasps
    steady: Array
    sight: Array
    known: KnownRegion

    @cached_property
    def local(self) -> Singles:
        """(k, m, 3) the region's pool of points in each hand's frame."""
        return hand_frame(self.known.pool[0], self.found.grasps)

    def point_rows(self) -> Singles:
        """Return (k, 64, 11): the points nearest to the room that each hand closes in.

        In order: the point in the hand's frame (3, half decimetres), how far outside a contact it
        lies along closing, its normal in the hand's frame (3, zeros where it is not known), whether
        it is measured, hidden or foreign (3), its height above the table.
        """
        grasps, about, local = self.found.grasps, self.known.pool[1], self.local
        beside = np.abs(local[..., 1]) - 0.5 * grasps.width[:, None].astype(np.float32)
        away = np.maximum(np.abs(local[..., 0]) / np.float32(ALONG), np.abs(local[..., 2]))
        np.maximum(away, beside, out=away)
        count = min(NUM_POINTS, len(about))
        nearest = np.argpartition(away, count - 1, axis=1)[:, :count]
        nearest = nearest[:, np.arange(NUM_POINTS) % count]
        chosen, place = about[nearest], np.take_along_axis(local, nearest[..., None], 1)
        columns = [
            20.0 * np.clip(place, -FARTHEST, FARTHEST),
            50.0 * np.clip(np.take_along_axis(beside, nearest, 1), -DEEPEST, DEEPEST)[..., None],
            chosen[..., :3] @ grasps.rotation.astype(np.float32),
            chosen[..., 3:],
        ]
        return np.concatenate(columns, axis=-1, dtype=np.float32)

    def hand_rows(self) -> Singles:
        """Return (k, 49): numbers about each hand's pose, its contacts and its region."""
        found, known = self.found, self.known
        grasps, slot, existence = found.grasps, found.slot, known.slots.existence
        columns = [
            10.0 * grasps.width,
            np.einsum("kia,i->ka", grasps.rotation, known.up),
            np.einsum("kia,ki->ka", grasps.rotation[..., :2], unit(grasps.translation)),
            self.steady,
            self.sight,
            20.0 * found.clearance,
            30.0 * found.enclosed_height,
            found.affordance,
            np.where(slot >= 0, existence[np.maximum(slot, 0)], 0.0),
            (slot >= 0) & (slot < ROTATION_SLOT),
            slot == ROTATION_SLOT,
            slot == SPHERE_SLOT,
            slot < 0,
            10.0 * known.heights(grasps.translation),
            self._between_fingers(),
            *_contact_patches(grasps, known.region),
            *_extent(grasps, known.region),
            np.broadcast_to(existence, (len(found), len(existence))),
        ]
        return np.column_stack(columns).astype(np.float32)

    def _between_fingers(self) -> Array:
        """Return (k, 2) how many measured and hidden points of the pool lie between the fingers."""
        along, across, third = np.moveaxis(self.local, -1, 0)
        inside = (np.abs(third) < FINGER_BAND) & (along < BEYOND) & (along > BEHIND)
        inside &= np.abs(across) < self.found.grasps.width[:, None] / 2 + BESIDE
        return np.asarray(inside @ self.known.pool[1][:, 3:5] / 50.0)


def hand_frame(points: Array, grasps: Grasps) -> Singles:
    """Return (k, m, 3) `points` (m, 3) in the frame of each of k hands."""
    middle = points.mean(axis=0)  # single precision is fine about it
    rotation = grasps.rotation.astype(np.float32)
    origin = np.einsum("ki,kia->ka", grasps.translation - middle, grasps.rotation)
    local = (points - middle).astype(np.float32) @ rotation
    return np.asarray(local - origin.astype(np.float32)[:, None])


def _contact_patches(grasps: Grasps, region: RegionCloud) -> list[Array]:
    """Return what is seen about each contact: how far it faces the finger, how evenly, how much.

    Hands of one pair of contacts share it.
    """
    contacts, closing = grasps.contacts, grasps.closing
    points, normals = thinned(region.points, PATCHED), thinned(region.normals, PATCHED)
    _, first, pair = np.unique(
        contacts.reshape(-1, 6).round(7), axis=0, return_index=True, return_inverse=True
    )
    middle = points.mean(axis=0)
    about, columns = points - middle, []
    for finger, outward in ((0, -1.0), (1, 1.0)):
        at = contacts[first, finger]
        # |p - a|^2 as a product of matrices, about the middle.
        away = np.square(about).sum(axis=1) - 2.0 * (at - middle) @ about.T
        away = np.sqrt(np.maximum(away + np.square(at - middle).sum(axis=1)[:, None], 0.0))
        facing = outward * closing[first] @ normals.T
        for radius in PATCHES:
            near = away < radius
            count = near.sum(axis=1)
            mean = np.where(near, facing, 0.0).sum(axis=1) / np.maximum(count, 1)
            spread = np.where(near, np.square(facing - mean[:, None]), 0.0).sum(axis=1)
            spread = np.sqrt(spread / np.maximum(count, 1))
            columns += [mean, spread, np.minimum(count, 30) / 30.0]
        nearest = away.argmin(axis=1)
        rows = np.arange(len(first))
        gap = away[rows, nearest]
        columns.append(30.0 * np.minimum(gap, 0.03))
        columns.append(facing[rows, nearest] * (gap < CONTACT_REACH))
    return [column[pair.reshape(-1)] for column in columns]


def _extent(grasps: Grasps, region: RegionCloud) -> list[Array]:
    """Return (k, 3) thrice, in half decimetres: mean about the middle, spread, the middle."""
    about = region.points - region.middle
    mean = about.mean(axis=0)
    scatter = (about - mean).T @ (about - mean) / len(about)
    R = grasps.rotation
    spread = np.sqrt(np.maximum(np.einsum("kia,ij,kja->ka", R, scatter, R), 0.0))
    offset = np.einsum("kia,ki->ka", R, region.middle - grasps.translation)
    return [20.0 * np.einsum("kia,i->ka", R, mean), 20.0 * spread, 20.0 * offset]
