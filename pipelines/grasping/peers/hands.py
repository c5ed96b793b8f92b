"""Hands of compared methods: their collisions, and the points between their fingers.

A hand is a frame with the axes of `GraspPoses` at a surface point; its finger tips reach `depth`
past the point along the approach. GraspNet's baseline has such hands too. Camera frame, metres.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.pointcloud import drawn_indices, voxel_downsample
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.rectangles import contact_width

HAND_VOXEL = 0.005  # metres, cell of thinned clouds
OPENING = 0.08  # metres, opening of PointNetGPD's hands
CLOSING_HEIGHT = 0.04  # metres along the binormal, height of the closing region
CLOSING_BEHIND = 0.02  # metres behind the point, where the closing region begins
# Metres, a hand in the collision test.
BODY_HEIGHT, FINGER_LENGTH, THICKNESS, APPROACH_PATH = 0.02, 0.06, 0.01, 0.03
MAX_FILLED = 0.01  # share of a hand's bodies' cells that may contain points
MIN_CLOSED_ON = 20  # points between the fingers; fewer are not enough


@dataclass(frozen=True)
class Hands:
    """Hands (n,).

    Attributes:
        rotation: (n, 3, 3) columns approach, closing, approach x closing.
        origin: (n, 3) metres.
        depth: (n,) metres from the origin to the finger tips.
        opening: (n,) metres between the fingers.
    """

    rotation: Array
    origin: Array
    depth: Array
    opening: Array

    @classmethod
    def equally_open(cls, rotation: Array, origin: Array, depth: Array) -> "Hands":
        """Return hands of PointNetGPD; arguments as the attributes."""
        return cls(rotation, origin, depth, np.full(len(depth), OPENING))

    @classmethod
    def none(cls) -> "Hands":
        """Return no hands."""
        return cls.equally_open(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))

    def __getitem__(self, index: Indices | Mask) -> "Hands":
        rows = self.rotation[index], self.origin[index], self.depth[index]
        return Hands(*rows, self.opening[index])

    def __len__(self) -> int:
        return len(self.depth)

    def closing_region(self, hand: int, points: Array) -> Array:
        """Return the `points` (k, 3) that a hand closes on, in the hand's frame."""
        local = (points - self.origin[hand]) @ self.rotation[hand]
        inside = (local[:, 0] > -CLOSING_BEHIND) & (local[:, 0] < self.depth[hand])
        inside &= np.abs(local[:, 1]) < self.opening[hand] / 2
        inside &= np.abs(local[:, 2]) < CLOSING_HEIGHT / 2
        return np.asarray(local[inside])


def hand_grasps(hands: Hands, gripper: Gripper) -> GraspPoses:
    """Return the grasps of `gripper` at `hands`, with equal opening if the gripper can."""
    contacts = hands.origin + (hands.depth - gripper.tip_reach)[:, None] * hands.rotation[:, :, 0]
    return GraspPoses(hands.rotation, contacts, contact_width(hands.opening, gripper))


def thinned(points: Array, size: float = HAND_VOXEL) -> Array:
    """Return one of `points` (n, 3) in each cell of edge `size`, for checks of hands."""
    return points[voxel_downsample(points, size)] if len(points) else points


def free_hands(
    hands: Hands,
    objects: Array,
    scene: Array,
    *,
    size: float = HAND_VOXEL,
    approach_path: float = APPROACH_PATH,
) -> Mask:
    """Return a mask (n,) of hands that do not meet `scene` and close on some of `objects`.

    Both clouds are thinned to cells of edge `size` metres; `approach_path`: metres behind the palm
    that must be free too.
    """
    body = (BODY_HEIGHT / 2, FINGER_LENGTH, THICKNESS, approach_path)
    rotation, origin, depth, half, objects, scene = map(
        np.ascontiguousarray,
        (hands.rotation, hands.origin, hands.depth, hands.opening / 2, objects, scene),
    )
    filled, _ = _occupancy(rotation, origin, depth, half, scene, body)
    _, inside = _occupancy(rotation, origin, depth, half, objects, body)
    palm = (hands.opening + 2 * THICKNESS) * (THICKNESS + approach_path)
    cells = BODY_HEIGHT * (2 * FINGER_LENGTH * THICKNESS + palm) / size**3
    return np.asarray((filled <= MAX_FILLED * cells) & (inside > 0))


def drawn_points(points: Array, count: int, rng: np.random.Generator) -> Singles:
    """Return `count` random `points` (n, 3); for smaller n, all points with repetitions."""
    return points[drawn_indices(len(points), count, rng)].astype(np.float32)


@compiled
def _occupancy(
    rotation: Array,
    origin: Array,
    depth: Array,
    half: Array,
    points: Array,
    body: tuple[float, float, float, float],
) -> tuple[Indices, Indices]:
    """Return the number of `points` in the bodies of each hand, and between its fingers.

    `half`: (n,) half openings. `body`: half height, length and thickness of the fingers, and the
    approach path.
    """
    level, length, thick, approach_path = body
    filled, inside = np.zeros(len(depth), np.int64), np.zeros(len(depth), np.int64)
    for h in range(len(depth)):
        front = depth[h] - length
        back = front - thick - approach_path
        for n in range(len(points)):
            x, y = points[n, 0] - origin[h, 0], points[n, 1] - origin[h, 1]
            z = points[n, 2] - origin[h, 2]
            up = x * rotation[h, 0, 2] + y * rotation[h, 1, 2] + z * rotation[h, 2, 2]
            along = x * rotation[h, 0, 0] + y * rotation[h, 1, 0] + z * rotation[h, 2, 0]
            if abs(up) >= level or along >= depth[h] or along <= back:
                continue
            side = abs(x * rotation[h, 0, 1] + y * rotation[h, 1, 1] + z * rotation[h, 2, 1])
            if side >= half[h] + thick:
                continue
            if along <= front or side > half[h]:
                filled[h] += 1
            else:
                inside[h] += 1
    return filled, inside
