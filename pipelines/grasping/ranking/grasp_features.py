"""What a hand meets, point by point: what the grasp critic looks at (D. 82).

The points about a hand are told in its own frame (approach, closing, third): where they lie to the
two contacts, how the surface faces there, and how they are known: measured on the region, put
there by its symmetries, or measured on something else. Beside them stand numbers about the pose
and the surface at each contact.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.geometry.transforms import unit
from pipelines.grasping.grasp_candidates import RankedGrasps
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.observation import RegionCloud
from pipelines.grasping.ranking.known_region import KnownRegion, thinned

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

NUM_POINTS = 64  # about a hand that are looked at
ALONG = 1.5  # how much farther points may lie along the approach than across
PATCHES = (0.006, 0.012)  # metres about a contact
PATCHED = 1500  # of the region's points that tell of it
CONTACT_REACH = 0.015  # metres within which the seen surface tells of a contact
REMOTE = 0.03  # metres, of distances to the nearest point of it
FARTHEST, DEEPEST = 0.15, 0.05  # metres, of coordinates and of distances from a finger's face
FINGER_BAND, BEHIND, BEYOND, BESIDE = 0.011, -0.04, 0.03, 0.01  # metres: the room between fingers
POINT_FEATURES = 11
GRASP_FEATURES = 49


@dataclass(frozen=True)
class GraspFeatures:
    """How k hands, feasible in the selection, stand to a region.

    Attributes:
        found: the hands, with clearance and enclosed height.
        stability: (k,) of the selection.
        visible: (k,) share of the finger tips' room that is seen to be free.
        known: the region.
    """

    found: RankedGrasps
    stability: Array
    visible: Array
    known: KnownRegion

    @cached_property
    def _local(self) -> Singles:
        """(k, 3, m) the region's pool of points in each hand's frame."""
        return grasp_frame(self.known.pool[0], self.found.grasps)

    @property
    def _half(self) -> Singles:
        """(k,) metres from the middle to a contact."""
        return (0.5 * self.found.grasps.width).astype(np.float32)

    @cached_property
    def _room(self) -> tuple[Singles, Singles]:
        """(k, m) how far the pool is from the room that each hand closes in; (k, 2) what is in it.

        The room's points are counted, measured and hidden.
        """
        starts = np.concatenate([[0], np.cumsum(self.known.pool[1][:, 3:5].sum(axis=0))])
        return _room(self._local, self._half, starts.astype(np.int64))

    def point_rows(self) -> Singles:
        """Return (k, 64, 11): the points nearest to the room that each hand closes in.

        In order: the point in the hand's frame (3, half decimetres), how far outside a contact it
        lies along closing, its normal in the hand's frame (3, zeros where it is not known), whether
        it is measured, hidden or foreign (3), its height above the table.
        """
        away = self._room[0]
        last = min(NUM_POINTS, away.shape[1]) - 1
        reach = np.ascontiguousarray(np.partition(away, last, axis=1)[:, last])
        rotation = self.found.grasps.rotation.astype(np.float32)
        return _nearest_rows(self._local, rotation, self._half, away, reach, self.known.pool[1])

    def grasp_rows(self) -> Singles:
        """Return (k, 49): numbers about each hand's pose, its contacts and its region."""
        found, known = self.found, self.known
        grasps, slot, existence = found.grasps, found.slot, known.slots.existence
        columns = [
            10.0 * grasps.width,
            np.einsum("kia,i->ka", grasps.rotation, known.up),
            np.einsum("kia,ki->ka", grasps.rotation[..., :2], unit(grasps.translation)),
            self.stability,
            self.visible,
            20.0 * found.clearance,
            30.0 * found.enclosed_height,
            found.affordance,
            np.where(slot >= 0, existence[np.maximum(slot, 0)], 0.0),
            (slot >= 0) & (slot < ROTATION_SLOT),
            slot == ROTATION_SLOT,
            slot == SPHERE_SLOT,
            slot < 0,
            10.0 * known.heights(grasps.translation),
            self._room[1] / 50.0,
            _contact_patches(grasps, known.region),
            *_extent(grasps, known.region),
            np.broadcast_to(existence, (len(found), len(existence))),
        ]
        return np.column_stack(columns).astype(np.float32)


def grasp_frame(points: Array, grasps: Grasps) -> Singles:
    """Return (k, 3, m) `points` (m, 3) in the frame of each of k hands."""
    middle = points.mean(axis=0)  # single precision is fine about it
    origin = np.einsum("ki,kia->ka", grasps.translation - middle, grasps.rotation)
    about = np.ascontiguousarray((points - middle).T, np.float32)
    return _turned(about, grasps.rotation.astype(np.float32), origin.astype(np.float32))


@compiled
def _turned(points: Singles, rotation: Singles, origin: Singles) -> Singles:
    """Return (k, 3, m) `points` (3, m) by each `rotation` (k, 3, 3), less `origin` (k, 3)."""
    local = np.empty((len(origin), 3, points.shape[1]), np.float32)
    for k in range(len(origin)):
        for axis in range(3):
            a, b, c = rotation[k, 0, axis], rotation[k, 1, axis], rotation[k, 2, axis]
            d = origin[k, axis]
            for m in range(points.shape[1]):
                local[k, axis, m] = a * points[0, m] + b * points[1, m] + c * points[2, m] - d
    return local


@compiled
def _room(local: Singles, half: Singles, starts: Indices) -> tuple[Singles, Singles]:
    """Return how far points `local` (k, 3, m) are from the room between contacts, `half` (k,) off.

    (k, m) metres, fewer along the approach; and (k, 2) how many of two kinds, which start and end
    at `starts` (3,), lie between the fingers.
    """
    away = np.empty((len(local), local.shape[2]), np.float32)
    between = np.zeros((len(local), 2), np.float32)
    shrink, band = np.float32(ALONG), np.float32(FINGER_BAND)
    behind, beyond = np.float32(BEHIND), np.float32(BEYOND)
    for k in range(len(local)):
        side = half[k] + np.float32(BESIDE)
        for m in range(local.shape[2]):
            along, across, third = abs(local[k, 0, m]), abs(local[k, 1, m]), abs(local[k, 2, m])
            away[k, m] = max(along / shrink, third, across - half[k])
        for kind in range(2):
            count = 0
            for m in range(starts[kind], starts[kind + 1]):
                along, across, third = local[k, 0, m], abs(local[k, 1, m]), abs(local[k, 2, m])
                count += (third < band) & (along < beyond) & (along > behind) & (across < side)
            between[k, kind] = count
    return away, between


@compiled
def _nearest_rows(
    local: Singles, rotation: Singles, half: Singles, away: Singles, reach: Singles, about: Singles
) -> Singles:
    """Return (k, 64, 11) the rows of the 64 points least `away` (k, m), as `point_rows` tells.

    In their own order; fewer are repeated. `local`: (k, 3, m). `rotation`: (k, 3, 3) of the hands.
    `half`: (k,) metres from the middle to a contact. `reach`: (k,) how far away the last is.
    `about`: (m, 7) normal, kind, height.
    """
    far, deep = np.float32(FARTHEST), np.float32(DEEPEST)
    rows = np.empty((len(reach), NUM_POINTS, POINT_FEATURES), np.float32)
    for k in range(len(reach)):
        left = NUM_POINTS  # for points as far away as the last one, of which some may go
        for m in range(len(about)):
            left -= away[k, m] < reach[k]
        count = 0
        for m in range(len(about)):
            if away[k, m] > reach[k] or (away[k, m] == reach[k] and left == 0):
                continue
            left -= away[k, m] == reach[k]
            for axis in range(3):
                place = min(max(local[k, axis, m], -far), far)
                rows[k, count, axis] = np.float32(20.0) * place
                rows[k, count, 4 + axis] = (
                    about[m, 0] * rotation[k, 0, axis]
                    + about[m, 1] * rotation[k, 1, axis]
                    + about[m, 2] * rotation[k, 2, axis]
                )
            beside = abs(local[k, 1, m]) - half[k]
            rows[k, count, 3] = np.float32(50.0) * min(max(beside, -deep), deep)
            for column in range(7, POINT_FEATURES):
                rows[k, count, column] = about[m, column - 4]
            count += 1
        for n in range(count, NUM_POINTS):
            for column in range(POINT_FEATURES):
                rows[k, n, column] = rows[k, n - count, column]
    return rows


def _contact_patches(grasps: Grasps, region: RegionCloud) -> Array:
    """Return (k, 16) what is seen about each contact, eight numbers each.

    How far it faces the finger, how evenly, how much is seen, within each of `PATCHES`; how far
    away the nearest point is, and how far that faces the finger.
    """
    points, normals = thinned(region.points, PATCHED), thinned(region.normals, PATCHED)
    contacts, pair = grasps.contacts, np.ones(len(grasps), bool)
    pair[1:] = (contacts[1:] != contacts[:-1]).any(axis=(1, 2))  # its hands come in turn
    about = np.ascontiguousarray(points.T)
    columns = _patches(contacts[pair], grasps.closing[pair], about, np.ascontiguousarray(normals))
    return np.asarray(columns[np.cumsum(pair) - 1])


@compiled
def _patches(contacts: Array, closing: Array, points: Array, normals: Array) -> Array:
    """Return what `_contact_patches` does, of pairs. `contacts`: (k, 2, 3). `points`: (3, n)."""
    columns = np.empty((len(contacts), 16))
    # The squared distances to all points; of those nearby, in front, and how these face.
    squared, facing = np.empty(points.shape[1]), np.empty(points.shape[1])
    for k in range(len(contacts)):
        for finger in range(2):
            start = 8 * finger
            x, y, z = contacts[k, finger, 0], contacts[k, finger, 1], contacts[k, finger, 2]
            for n in range(len(squared)):
                a, b, c = points[0, n] - x, points[1, n] - y, points[2, n] - z
                squared[n] = a * a + b * b + c * c
            side = 2.0 * finger - 1.0
            x, y, z = side * closing[k, 0], side * closing[k, 1], side * closing[k, 2]
            least, opposed, count = REMOTE**2, 0.0, 0
            for n in range(len(squared)):
                away = squared[n]
                if away < CONTACT_REACH**2:
                    cosine = x * normals[n, 0] + y * normals[n, 1] + z * normals[n, 2]
                    opposed = cosine if away < least else opposed
                    squared[count], facing[count] = away, cosine
                    count += 1
                if away < REMOTE**2:
                    least = min(least, away)
            for radius in PATCHES:
                mean, spread, seen = _patch(facing, squared, count, radius)
                columns[k, start], columns[k, start + 1], columns[k, start + 2] = mean, spread, seen
                start += 3
            columns[k, start] = 30.0 * np.sqrt(least)
            columns[k, start + 1] = opposed
    return columns


@compiled
def _patch(facing: Array, squared: Array, count: int, radius: float) -> tuple[float, float, float]:
    """Return mean and spread of the first `count` of `facing` (n,) within `radius`; how many."""
    seen, total, scatter = 0, 0.0, 0.0
    for n in range(count):
        if squared[n] < radius * radius:
            seen += 1
            total += facing[n]
    mean = total / max(seen, 1)
    for n in range(count):
        if squared[n] < radius * radius:
            scatter += (facing[n] - mean) ** 2
    return mean, np.sqrt(scatter / max(seen, 1)), min(seen, 30) / 30.0


def _extent(grasps: Grasps, region: RegionCloud) -> list[Array]:
    """Return (k, 3) thrice, in half decimetres: mean about the middle, spread, the middle."""
    about = region.points - region.middle
    mean = about.mean(axis=0)
    off = about - mean
    R = grasps.rotation
    spread = np.sqrt(np.maximum((R * (off.T @ off / len(off) @ R)).sum(axis=1), 0.0))
    offset = np.einsum("kia,ki->ka", R, region.middle - grasps.translation)
    return [20.0 * np.einsum("kia,i->ka", R, mean), 20.0 * spread, 20.0 * offset]
