"""A robot's gripper, or an arm, that enters an image from its border. Camera frame, metres."""

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, transform_points, unit
from pipelines.synthesis.objects.decomposition import hull_of_points
from pipelines.synthesis.objects.solids import CORNERS, on_levels

DEEPEST = 0.8  # of the distance from camera to table, so that the hand stays above the table
ARM_LENGTH = 0.6  # metres, long enough to leave the image


def drawn_hand(intrinsics: Intrinsics, T_world_cam: Array, rng: np.random.Generator) -> Mesh:
    """Return a random hand with an arm that leaves the image; camera frame.

    `T_world_cam`: (4, 4); the table is z = 0 of the world.
    """
    border, inward = _border(intrinsics, rng)
    size = np.array([intrinsics.width, intrinsics.height])
    tip = border + inward * rng.uniform(0.08, 0.4) * size
    ray = intrinsics.points_at(tip[None], np.ones(1))[0]
    down = float(T_world_cam[2, :3] @ ray)
    table = -float(T_world_cam[2, 3]) / down if down < -1e-6 else 2.0
    place = ray * max(0.15, min(table, 2.0) * rng.uniform(0.35, DEEPEST))
    outward = np.array([-inward[0], -inward[1], rng.uniform(-0.6, 0.1)])
    axis = unit(outward + rng.normal(0.0, 0.25, 3))
    side = unit(np.cross(axis, rng.normal(size=3)))
    pose = make_pose(np.stack([side, np.cross(axis, side), axis], -1), place)
    parts = _gripper(rng) if rng.uniform() < 0.7 else _fist(rng)
    return Mesh.concatenate([hull_of_points(transform_points(pose, part)) for part in parts])


def _border(intrinsics: Intrinsics, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a pixel (2,) of the picture's border and the direction (2,) inward."""
    along, side = rng.uniform(0.1, 0.9), int(rng.integers(4))
    size = np.array([intrinsics.width, intrinsics.height], np.float64)
    axis, far = side % 2, side // 2
    pixel, inward = size * along, np.zeros(2)
    pixel[axis], inward[axis] = far * size[axis], 1.0 - 2.0 * far
    return pixel, inward


def _gripper(rng: np.random.Generator) -> list[Array]:
    """Return the corners of two fingers, a palm and an arm along z, the finger tips at z = 0."""
    length, opening = rng.uniform(0.04, 0.1), rng.uniform(0.01, 0.1)
    wide, thick = rng.uniform(0.01, 0.025), rng.uniform(0.006, 0.02)
    palm = rng.uniform(0.03, 0.07)
    fingers = [
        _block([wide, thick, length], [0.0, sign * 0.5 * (opening + thick), 0.5 * length])
        for sign in (-1.0, 1.0)
    ]
    size = [rng.uniform(0.04, 0.08), max(0.1, opening + 2.5 * thick), palm]
    base = _block(size, [0.0, 0.0, length + 0.5 * palm])
    return [*fingers, base, *_arm(length + palm, rng)]


def _fist(rng: np.random.Generator) -> list[Array]:
    """Return the points of a closed hand of blunt fingers and an arm along z."""
    width, length = rng.uniform(0.06, 0.09), rng.uniform(0.06, 0.1)
    knuckles = np.linspace(-0.5, 0.5, 4) * 0.8 * width
    fingers = [
        _drum(0.13 * width, 0.0, length * rng.uniform(0.5, 0.9), 10) + np.array([x, 0.0, 0.0])
        for x in knuckles
    ]
    back = _block([width, 0.4 * width, length], [0.0, 0.01, 0.4 * length + 0.5 * length])
    return [*fingers, back, *_arm(1.3 * length, rng)]


def _arm(start: float, rng: np.random.Generator) -> list[Array]:
    """Return a wrist and a thicker arm from z = `start` on."""
    wrist, arm = rng.uniform(0.02, 0.04), rng.uniform(0.03, 0.06)
    bend = start + rng.uniform(0.03, 0.15)
    sides = int(rng.choice([6, 20]))
    return [_drum(wrist, start - 0.01, bend, sides), _drum(arm, bend, bend + ARM_LENGTH, sides)]


def _block(size: list[float], middle: list[float]) -> Array:
    return np.asarray(0.5 * CORNERS * size + middle)


def _drum(radius: float, low: float, high: float, sides: int) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    return on_levels(radius * np.column_stack([np.cos(angle), np.sin(angle)]), low, high)
