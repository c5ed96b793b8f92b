"""Region clouds of boxes, cans and balls seen from one side, with their true labels."""

import numpy as np
import torch

from pipelines.geometry.transforms import random_rotation, rotation_about
from pipelines.network.training.region_batch import RegionBatch

DOWN = np.array([[1.0, 0, 0], [0, -0.5, -0.866], [0, 0.866, -0.5]])  # table up to camera axes


def surface(kind: int, size: np.ndarray, count: int, rng: np.random.Generator):
    """Points (count, 3) and normals on a box (0), a can (1) or a ball (2), object frame."""
    if kind == 2:
        normals = rng.normal(size=(count, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals * size[0], normals
    points, normals = rng.uniform(-1, 1, (count, 3)), np.zeros((count, 3))
    if kind == 0:
        axis, sign = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
        points[np.arange(count), axis] = normals[np.arange(count), axis] = sign
        return points * size, normals
    turn, lid = rng.uniform(0, 2 * np.pi, count), rng.random(count) < 0.3
    radius = np.where(lid, np.sqrt(rng.random(count)), 1.0)
    points[:, :2] = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)
    points[lid, 2] = np.sign(points[lid, 2])
    normals[~lid, :2], normals[lid, 2] = points[~lid, :2], points[lid, 2]
    return points * size[[0, 0, 2]], normals


def region(kind: int, count: int, rng: np.random.Generator, tumbled: bool = False):
    """The fields of a `RegionBatch` of one region; table unknown."""
    size = rng.uniform(0.02, 0.06, 3)
    points, normals = surface(kind, size, 40 * count, rng)
    R = DOWN @ (
        random_rotation(rng) if tumbled else rotation_about([0, 0, 1.0], 6.3 * rng.random())
    )
    center = np.array([0.0, 0.0, 0.6])
    points, normals = points @ R.T + center, normals @ R.T
    seen = np.flatnonzero((points * normals).sum(1) < 0)[:count]
    affordance = 0.8 * (np.abs(normals[seen] @ R[:, 2]) < 0.5)
    existence, where, direction = np.zeros(5), np.zeros((5, 3)), np.zeros((5, 3))
    slots = {0: {0: 0, 1: 1, 2: 2}, 1: {0: 2, 3: 2}, 2: {}}[kind]
    for slot, axis in slots.items():
        existence[slot], direction[slot] = 1.0, R[:, axis]
    if kind == 2:
        existence[4] = 1.0
    centroid = points[seen].mean(0)
    where[existence > 0] = center - centroid
    noisy = points[seen] - centroid + 0.001 * rng.normal(size=(len(seen), 3))
    return noisy, affordance, existence, where, direction, np.zeros(()), -centroid


def toy_batch(size: int, count: int = 128, seed: int = 0, tumbled: bool = False) -> RegionBatch:
    """A batch of boxes, cans and balls in turn."""
    rng = np.random.default_rng(seed)
    regions = [region(i % 3, count, rng, tumbled) for i in range(size)]
    return RegionBatch(
        *(torch.from_numpy(np.stack(each)).float() for each in zip(*regions, strict=True))
    )
