"""Hands of PointNetGPD: what hinders them, and the points that they close on.

A hand is a frame as `GraspPoses` has it, at a point of the surface; its finger tips reach `depth`
past the point along the approach. All hands open equally wide. Camera frame, metres.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.pointcloud import voxel_downsample

HAND_VOXEL = 0.005  # metres, of thinned clouds
OPENING, HEIGHT = 0.08, 0.02  # metres, of every hand
BEHIND = 0.02  # metres behind the point that the closing region begins
FINGER_LENGTH, THICKNESS, WAY_IN = 0.06, 0.01, 0.03  # metres, of a hand in the collision test
MAX_FILLED = 0.01  # share of the cells of a hand's bodies that may hold points
MIN_CLOSED_ON = 20  # between the fingers; fewer show nothing


@dataclass(frozen=True)
class Hands:
    """Hands (n,).

    Attributes:
        rotation: (n, 3, 3) columns approach, closing, approach x closing.
        origin: (n, 3) metres.
        depth: (n,) metres from the origin to the finger tips.
    """

    rotation: Array
    origin: Array
    depth: Array

    def __getitem__(self, index: Indices | Mask) -> "Hands":
        return Hands(self.rotation[index], self.origin[index], self.depth[index])

    def __len__(self) -> int:
        return len(self.depth)

    def closing_region(self, hand: int, points: Array) -> Array:
        """Return (k, 3) those of `points` (n, 3) that a hand closes on, in the hand's frame."""
        local = (points - self.origin[hand]) @ self.rotation[hand]
        inside = (local[:, 0] > -BEHIND) & (local[:, 0] < self.depth[hand])
        inside &= (np.abs(local[:, 1]) < OPENING / 2) & (np.abs(local[:, 2]) < HEIGHT)
        return np.asarray(local[inside])


def thinned(points: Array) -> Array:
    """Return one of `points` (n, 3) in each cell of the clouds that hands are checked with."""
    return points[voxel_downsample(points, HAND_VOXEL)] if len(points) else points


def free_hands(hands: Hands, objects: Array, scene: Array) -> Mask:
    """Return (n,) which hands do not meet the cloud `scene`, and close on some of `objects`.

    Both clouds are thinned.
    """
    body = (OPENING / 2, HEIGHT / 2, FINGER_LENGTH, THICKNESS, WAY_IN)
    rotation, origin, depth, objects, scene = map(
        np.ascontiguousarray, (hands.rotation, hands.origin, hands.depth, objects, scene)
    )
    filled, _ = _occupancy(rotation, origin, depth, scene, body)
    _, inside = _occupancy(rotation, origin, depth, objects, body)
    palm = (OPENING + 2 * THICKNESS) * (THICKNESS + WAY_IN)
    cells = HEIGHT * (2 * FINGER_LENGTH * THICKNESS + palm) / HAND_VOXEL**3
    return np.asarray((filled <= MAX_FILLED * cells) & (inside > 0))


def drawn_points(points: Array, count: int, rng: np.random.Generator) -> Singles:
    """Return `count` of `points` (n, 3) at random; all of them and some twice where n is less."""
    chosen = rng.permutation(len(points))[:count]
    if len(points) < count:
        chosen = np.concatenate([chosen, rng.integers(len(points), size=count - len(points))])
    return points[chosen].astype(np.float32)


@compiled
def _occupancy(
    rotation: Array,
    origin: Array,
    depth: Array,
    points: Array,
    body: tuple[float, float, float, float, float],
) -> tuple[Indices, Indices]:
    """Return how many of `points` lie in the bodies of each hand, and between its fingers.

    `body`: half opening, half height, length and thickness of the fingers, and the way in.
    """
    half, level, length, thick, way_in = body
    filled, inside = np.zeros(len(depth), np.int64), np.zeros(len(depth), np.int64)
    for h in range(len(depth)):
        front = depth[h] - length
        back = front - thick - way_in
        for n in range(len(points)):
            x, y = points[n, 0] - origin[h, 0], points[n, 1] - origin[h, 1]
            z = points[n, 2] - origin[h, 2]
            up = x * rotation[h, 0, 2] + y * rotation[h, 1, 2] + z * rotation[h, 2, 2]
            along = x * rotation[h, 0, 0] + y * rotation[h, 1, 0] + z * rotation[h, 2, 0]
            if abs(up) >= level or along >= depth[h] or along <= back:
                continue
            side = abs(x * rotation[h, 0, 1] + y * rotation[h, 1, 1] + z * rotation[h, 2, 1])
            if side >= half + thick:
                continue
            if along <= front or side > half:
                filled[h] += 1
            else:
                inside[h] += 1
    return filled, inside
