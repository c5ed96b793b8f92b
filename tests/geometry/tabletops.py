"""Depth images of boxes, cylinders and balls on a table, by casting rays in numpy."""

from dataclasses import dataclass

import numpy as np

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points

CAMERA = Intrinsics(262.0, 262.0, 159.5, 119.5, 320, 240)
TABLE_HALF = (0.45, 0.35)  # metres


@dataclass(frozen=True)
class Box:
    """A box with `size` (3,), the middle of its bottom at `at` (3,), turned by `yaw`."""

    size: tuple[float, float, float]
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw: float = 0.0

    def cast(self, origin, rays):
        c, s = np.cos(-self.yaw), np.sin(-self.yaw)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        o, d = (origin - np.array(self.at)) @ turn.T, rays @ turn.T
        low, high = np.array([-0.5, -0.5, 0]) * self.size, np.array([0.5, 0.5, 1]) * self.size
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - o) / d, (high - o) / d
        near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
        return np.where((near <= far) & (near > 0), near, np.inf)


@dataclass(frozen=True)
class Ball:
    """A ball whose centre is at `at` (3,)."""

    radius: float
    at: tuple[float, float, float]

    def cast(self, origin, rays):
        o = origin - np.array(self.at)
        a, b, c = (rays**2).sum(-1), rays @ o, o @ o - self.radius**2
        root = b**2 - a * c
        return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


@dataclass(frozen=True)
class Can:
    """An upright cylinder standing at `at` (3,)."""

    radius: float
    height: float
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def cast(self, origin, rays):
        o = origin - np.array(self.at)
        a, b = (rays[..., :2] ** 2).sum(-1), rays[..., :2] @ o[:2]
        root = b**2 - a * (o[:2] @ o[:2] - self.radius**2)
        side = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        z = o[2] + np.where(np.isfinite(side), side, 0) * rays[..., 2]
        side = np.where((z >= 0) & (z <= self.height), side, np.inf)
        top = (self.height - o[2]) / rays[..., 2]
        hit = o + np.where(np.isfinite(top), top, 0)[..., None] * rays
        top = np.where(
            (hit[..., 0] ** 2 + hit[..., 1] ** 2 < self.radius**2) & (top > 0), top, np.inf
        )
        return np.minimum(side, top)


@dataclass(frozen=True)
class Cup:
    """The outside, or the inside, of an upright cup with a thin wall that stands at `at` (3,)."""

    radius: float
    height: float
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inside: bool = False

    def cast(self, origin, rays):
        o = origin - np.array(self.at)
        a, b = (rays[..., :2] ** 2).sum(-1), rays[..., :2] @ o[:2]
        root = b**2 - a * (o[:2] @ o[:2] - self.radius**2)
        hit, width = root > 0, np.sqrt(np.maximum(root, 0))
        front, back = (-b - width) / a, (-b + width) / a
        enters, leaves = (o[2] + side * rays[..., 2] for side in (front, back))
        if not self.inside:
            return np.where(hit & (enters >= 0) & (enters <= self.height), front, np.inf)
        wall_or_bottom = np.where(leaves >= 0, back, -o[2] / rays[..., 2])
        return np.where(
            hit & (enters > self.height) & (leaves < self.height), wall_or_bottom, np.inf
        )


def looking_at_table(distance=0.7, elevation=0.9):
    """Return T_cam_table of a camera that looks at the table's middle from `elevation` radians."""
    forward = np.array([0.0, np.cos(elevation), -np.sin(elevation)])
    right = np.array([1.0, 0.0, 0.0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ (-distance * forward)
    return pose


def render(shapes, T_cam_table=None, camera=CAMERA):
    """Return depth (H, W), metres, and index (H, W) of the seen shape, -1 for table or nothing."""
    T = looking_at_table() if T_cam_table is None else T_cam_table
    T_table_cam = invert(T)
    rays = rotate_vectors(T_table_cam, camera.rays())
    origin = transform_points(T_table_cam, np.zeros(3))
    table = -origin[2] / np.where(rays[..., 2] < 0, rays[..., 2], np.nan)
    hit = origin + table[..., None] * rays
    on_table = (np.abs(hit[..., :2]) < TABLE_HALF).all(-1)
    depths = [np.where(on_table, table, np.inf)] + [shape.cast(origin, rays) for shape in shapes]
    depth = np.min(depths, axis=0)
    index = np.argmin(depths, axis=0) - 1
    return np.where(np.isfinite(depth), depth, 0.0), np.where(np.isfinite(depth), index, -1)
