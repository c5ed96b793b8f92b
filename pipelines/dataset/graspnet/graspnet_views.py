"""The view template of GraspNet-1Billion's labels, and rotations of views and in-plane angles.

The original computes both in NumPy 1, where float32 arrays stay float32; under NumPy 2 the same
code gives float64, with differences up to 8e-5. Here float32 is explicit.
"""

import numpy as np

from pipelines.array_types import Floats, Singles

NUM_VIEWS = 300
NUM_ANGLES = 12  # in-plane rotations, k * pi / 12
NUM_DEPTHS = 4  # 0.01 .. 0.04 m
IN_PLANE_ANGLES = np.arange(NUM_ANGLES) * (np.pi / NUM_ANGLES)
GRASP_DEPTHS = 0.01 * np.arange(1, NUM_DEPTHS + 1)

GOLDEN_RATIO = np.float32((np.sqrt(5.0) - 1.0) / 2.0)


def generate_views(count: int = NUM_VIEWS) -> Singles:
    """Return the view directions (count, 3) of a Fibonacci lattice, float32 unit vectors.

    A view points from the object to the camera: a grasp of view v approaches along -v.
    """
    index = np.arange(count, dtype=np.float32)
    z = (np.float32(2) * index + np.float32(1)) / np.float32(count) - np.float32(1)
    radius = np.sqrt(np.float32(1) - z**2)
    # The order of the products is as in the original: in float32 it decides the last digits.
    turn = np.float32(2) * index * np.float32(np.pi) * GOLDEN_RATIO
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def view_rotations(angles: Floats = IN_PLANE_ANGLES) -> Singles:
    """Return the grasp rotations (300, A, 3, 3) of every view at each of `angles`, radians.

    float32, columns approach, closing, approach x closing, object frame.
    """
    frames = _untwisted_frames(-generate_views())  # (V, 3, 3)
    cosine, sine = np.cos(angles), np.sin(angles)
    twist = np.zeros((len(angles), 3, 3))
    twist[:, 0, 0] = 1.0
    twist[:, 1, 1], twist[:, 1, 2] = cosine, -sine
    twist[:, 2, 1], twist[:, 2, 2] = sine, cosine
    return np.asarray(frames[:, None] @ twist[None], dtype=np.float32)


def _untwisted_frames(approach: Floats) -> Floats:
    """Return frames (V, 3, 3) with `approach` as first column and a level second column."""
    closing = np.stack([-approach[:, 1], approach[:, 0], np.zeros_like(approach[:, 0])], axis=1)
    closing = closing / np.linalg.norm(closing, axis=1, keepdims=True)  # no view is upright
    approach = approach / np.linalg.norm(approach, axis=1, keepdims=True)
    return np.stack([approach, closing, np.cross(approach, closing)], axis=2)
