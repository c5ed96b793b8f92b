"""Features of the seen surface at the two contacts of a grasp."""

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.strides import strided_at_most
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.scene import RegionCloud

# All chosen by eye; the shipped weights were trained with these values.
RADII = (0.006, 0.012)  # metres, radii of the patches about a contact
NUM_POINTS = 1500  # of the region, at most, for measuring the patches
CONTACT_REACH = 0.015  # metres within which the nearest point's normal is the contact's
FARTHEST = 0.03  # metres, cap of the distance to the nearest point
DISTANCE_SCALE = 30.0  # per metre: brings the distance near one
ENOUGH = 30  # points in a patch; more add nothing

OF_A_PATCH = ("alignment", "alignment_spread", "points")
OF_A_CONTACT = (
    *(f"{name}_{1000 * radius:.0f}mm" for radius in RADII for name in OF_A_PATCH),
    "distance",
    "alignment_nearest",
)
PATCH_FEATURES = tuple(f"{which}_{name}" for which in ("first", "second") for name in OF_A_CONTACT)
COLUMNS = len(OF_A_CONTACT)


def contact_patches(grasps: GraspPoses, region: RegionCloud) -> Array:
    """Return the `PATCH_FEATURES` (k, 16) of k grasps at `region`, eight for each contact.

    For the points within each of `RADII`: mean and spread of the cosine between their normals and
    the closing axis, positive if the surface faces the finger, and their number. For the nearest
    point: its distance, and the same cosine.
    """
    points = strided_at_most(region.points, NUM_POINTS)
    normals = strided_at_most(region.normals, NUM_POINTS)
    contacts, is_new = grasps.contacts, np.ones(len(grasps), bool)
    # Grasps about one pair of contacts are consecutive and share the pair's features.
    is_new[1:] = (contacts[1:] != contacts[:-1]).any(axis=(1, 2))
    about = np.ascontiguousarray(points.T)
    closing = grasps.closing[is_new]
    columns = _patches(contacts[is_new], closing, about, np.ascontiguousarray(normals))
    return np.asarray(columns[np.cumsum(is_new) - 1])


@compiled
def _patches(contacts: Array, closing: Array, points: Array, normals: Array) -> Array:
    """Return features (k, 16) of `contacts` (k, 2, 3), `closing` (k, 3) among `points` (3, n)."""
    columns = np.empty((len(contacts), 2 * COLUMNS))
    # Squared distances of all points; then, at the front, of the near points, with their cosines.
    squared, facing = np.empty(points.shape[1]), np.empty(points.shape[1])
    for k in range(len(contacts)):
        for finger in range(2):
            start = COLUMNS * finger
            x, y, z = contacts[k, finger, 0], contacts[k, finger, 1], contacts[k, finger, 2]
            for n in range(len(squared)):
                a, b, c = points[0, n] - x, points[1, n] - y, points[2, n] - z
                squared[n] = a * a + b * b + c * c
            side = 2.0 * finger - 1.0
            x, y, z = side * closing[k, 0], side * closing[k, 1], side * closing[k, 2]
            least, opposed, count = FARTHEST**2, 0.0, 0
            for n in range(len(squared)):
                away = squared[n]
                if away < CONTACT_REACH**2:
                    cosine = x * normals[n, 0] + y * normals[n, 1] + z * normals[n, 2]
                    opposed = cosine if away < least else opposed
                    squared[count], facing[count] = away, cosine
                    count += 1
                if away < FARTHEST**2:
                    least = min(least, away)
            for radius in RADII:
                mean, spread, seen = _patch(facing, squared, count, radius)
                columns[k, start], columns[k, start + 1], columns[k, start + 2] = mean, spread, seen
                start += 3
            columns[k, start] = DISTANCE_SCALE * np.sqrt(least)
            columns[k, start + 1] = opposed
    return columns


@compiled
def _patch(facing: Array, squared: Array, count: int, radius: float) -> tuple[float, float, float]:
    """Return mean and spread of `facing[:count]` inside a patch, and the number of its points."""
    seen, total, scatter = 0, 0.0, 0.0
    for n in range(count):
        if squared[n] < radius * radius:
            seen += 1
            total += facing[n]
    mean = total / max(seen, 1)
    for n in range(count):
        if squared[n] < radius * radius:
            scatter += (facing[n] - mean) ** 2
    return mean, np.sqrt(scatter / max(seen, 1)), min(seen, ENOUGH) / ENOUGH
