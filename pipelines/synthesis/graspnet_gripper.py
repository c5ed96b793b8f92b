"""GraspNet's gripper against surface samples and a table: collision of grasp labels.

The gripper is the one of GraspNet-1Billion's evaluation: two fingers and a slab behind them, in
the grasp frame about GraspNet's origin. A label's candidates share their origin by the thousand
and their approach by the dozen, so samples are turned once a view and spun for the angles.
"""

import numpy as np
from numpy.typing import NDArray

from pipelines.formats.graspnet_labels import GRID
from pipelines.formats.graspnet_views import ANGLES, DEPTHS, view_rotations

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Mask = NDArray[np.bool_]

HALF_HEIGHT = 0.01  # metres to each side along approach x closing
FINGER = 0.01  # metres that a finger is thick along closing
FINGER_BACK = -0.02  # metres along approach, where fingers begin and the slab ends
SLAB_BACK = -0.03  # metres along approach, where the slab begins


def hits_samples(
    samples: NDArray[np.floating],
    origin: NDArray[np.floating],
    candidates: Mask,
    width: NDArray[np.floating],
) -> Mask:
    """Return which candidates of one grasp point have a sample within the gripper's boxes.

    Args:
        samples: (n, 3) metres, points of surfaces, object frame.
        origin: (3,) metres, the grasp point, object frame.
        candidates: (300, 12, 4) the views, angles and depths to test; the others are False.
        width: (300, 12, 4) metres, openings.
    """
    hit = np.zeros(GRID, np.bool_)
    views = np.flatnonzero(candidates.any(axis=(1, 2)))
    if not len(views) or not len(samples):
        return hit
    half = (0.5 * np.asarray(width)).astype(np.float32)
    view, q = _near_gripper(samples - origin, views, half, candidates)
    wanted = np.asarray(candidates.any(axis=2))  # (300, 12)
    for angle, (cosine, sine) in enumerate(_turns()):
        level = cosine * q[2] - sine * q[1]
        near = np.flatnonzero((np.abs(level) < HALF_HEIGHT) & wanted[view, angle])
        side = np.abs(cosine * q[1, near] + sine * q[2, near])[:, None]
        touched = _inside(q[0, near, None], side, half[view[near], angle])
        row, depth = np.nonzero(touched)
        hit[view[near[row]], angle, depth] = True
    return hit & candidates


def _near_gripper(
    around: Array, views: NDArray[np.int64], half: Singles, candidates: Mask
) -> tuple[NDArray[np.int64], Singles]:
    """Return view (k,) and coordinates (3, k) at angle 0 of samples that some box might hold."""
    # Per view, whatever the angle: how near the approach fingers come, and how far boxes reach.
    inner = np.where(candidates, half, np.inf).min(axis=(1, 2))[views, None]
    outer = np.where(candidates, half, 0.0).max(axis=(1, 2))[views, None] + FINGER
    outer_squared = (outer**2 + HALF_HEIGHT**2).astype(np.float32)
    tips = np.where(candidates, DEPTHS, 0.0).max(axis=(1, 2))[views, None].astype(np.float32)
    points = around.astype(np.float32)
    square = np.einsum("ni,ni->n", points, points)
    near = square < outer_squared.max() + max(DEPTHS.max(), -SLAB_BACK) ** 2
    points, square = points[near], square[near]
    frames = view_rotations(angles=np.zeros(1))[views, 0]
    along = frames[:, :, 0] @ points.T  # (v, n)
    away = square - along**2  # from the line of approach, squared
    reached = (along > SLAB_BACK) & (along < tips) & (away < outer_squared)
    reached &= (along < FINGER_BACK) | (away > 0.999 * inner.astype(np.float32) ** 2)
    row, sample = np.nonzero(reached)
    across = np.einsum("kij,ki->jk", frames[row, :, 1:], points[sample])
    return views[row], np.concatenate([along[row, sample][None], across])


def _turns() -> list[tuple[np.float32, np.float32]]:
    return list(
        zip(np.cos(ANGLES).astype(np.float32), np.sin(ANGLES).astype(np.float32), strict=True)
    )


def _inside(along: Singles, side: Singles, half: Singles) -> Mask:
    """Return (k, 4) whether samples at `along`, `side` (k, 1) lie in boxes of half openings."""
    finger = (along > FINGER_BACK) & (along < DEPTHS.astype(np.float32)) & (side > half)
    slab = (along > SLAB_BACK) & (along < FINGER_BACK)
    return (finger | slab) & (side < half + np.float32(FINGER))


def hits_plane(width: NDArray[np.floating], normal: Array, height: Array) -> Mask:
    """Return (p, 300, 12, 4) whether the gripper reaches below a plane.

    Args:
        width: (p, 300, 12, 4) metres, openings.
        normal: (3,) unit, out of the table, object frame.
        height: (p,) metres of the grasp points above the plane.
    """
    # Slab and fingers all reach the same distance sideways, so the lowest corner of the boxes is
    # the lowest corner of the one box around them.
    up = np.einsum("i,vaij->jva", normal, view_rotations())[..., None]  # (3, 300, 12, 1)
    outer = 0.5 * width + FINGER
    lowest = np.minimum(SLAB_BACK * up[0], DEPTHS * up[0]) - HALF_HEIGHT * np.abs(up[2])
    lowest = lowest - outer * np.abs(up[1])
    return np.asarray(height[:, None, None, None] + lowest < 0.0)
