"""Collision of GraspNet's gripper with surfaces and a table, for grasp labels.

The gripper is as in GraspNet-1Billion's evaluation: two fingers and a slab behind them, in the
grasp frame about GraspNet's origin. Thousands of candidates share an origin, dozens an approach, so
surface points are rotated once per view and then about the approach for the angles.
"""

from collections.abc import Iterator

import numpy as np

from pipelines.array_types import Array, Floats, Indices, Mask, Singles
from pipelines.dataset.graspnet.graspnet_labels import LABEL_GRID
from pipelines.dataset.graspnet.graspnet_views import GRASP_DEPTHS, IN_PLANE_ANGLES, view_rotations
from pipelines.geometry.meshes.surface_patches import SurfacePatches, meet_boxes

HALF_HEIGHT = 0.01  # metres to each side along approach x closing
FINGER_THICKNESS = 0.01  # metres along closing
FINGER_BACK = -0.02  # metres along approach, where fingers begin and the slab ends
SLAB_BACK = -0.03  # metres along approach, where the slab begins
SCOUT_STRIDE = 3  # every third patch is tried before the others


def hits_surface(surface: SurfacePatches, origin: Array, candidates: Mask, width: Floats) -> Mask:
    """Return the mask (300, 12, 4) of a grasp point's candidates whose gripper meets a surface.

    The test is exact: if no patch centre is in a box, the triangles of nearby patches are tested.

    Args:
        surface: object frame, metres.
        origin: (3,) metres, the grasp point, object frame.
        candidates: (300, 12, 4) views, angles and depths to test; False elsewhere.
        width: (300, 12, 4) metres, openings.
    """
    hit = np.zeros(LABEL_GRID, np.bool_)
    half = (0.5 * np.asarray(width)).astype(np.float32)
    scouts = surface.centers[::SCOUT_STRIDE]  # a few points find most collisions
    for view, angle, depth, _, held in _held(scouts, origin, candidates, half, 0.0):
        hit[view[held], angle, depth[held]] = True
    grow = float(surface.radius.max(initial=0.0))
    near = [
        (view, np.full(len(view), angle), depth, patch, held)
        for view, angle, depth, patch, held in _held(
            surface.centers, origin, candidates & ~hit, half, grow
        )
    ]
    if not near:
        return hit
    view, angle_of, depth, patch, held = (
        np.concatenate(parts) for parts in zip(*near, strict=True)
    )
    hit[view[held], angle_of[held], depth[held]] = True
    open_ = ~hit[view, angle_of, depth]
    index = np.stack([view[open_], angle_of[open_], depth[open_]])
    met = _patches_meet(surface, origin, index, patch[open_], width)
    hit[tuple(index[:, met])] = True
    return hit


def _patches_meet(
    surface: SurfacePatches, origin: Array, index: Indices, patch: Indices, width: Floats
) -> Mask:
    """Return the mask (m,) of candidates `index` (3, m) with a gripper that meets `patch` (m,)."""
    frames = view_rotations().astype(np.float64)[index[0], index[1]]
    half, tips = 0.5 * np.asarray(width, np.float64)[tuple(index)], GRASP_DEPTHS[index[2]]
    centers = np.einsum("mi,mij->mj", surface.centers[patch] - origin, frames)
    met = np.zeros(len(patch), np.bool_)
    for low, high in gripper_boxes(half, tips):
        away = np.maximum(np.maximum(low - centers, centers - high), 0.0)
        near = np.flatnonzero((away**2).sum(axis=1) < surface.radius[patch] ** 2)
        pair, triangle = surface.triangles_of(patch[near])
        row = near[pair]
        corners = (surface.triangles[triangle] - origin) @ frames[row]
        met[row[meet_boxes(corners, low[row], high[row])]] = True
    return met


def gripper_boxes(half: Array, tips: Array) -> list[tuple[Array, Array]]:
    """Return lowest and highest corners (n, 3) of the boxes of fingers and slab, grasp frame.

    `half`: (n,) half openings, metres; `tips`: (n,) reach of the fingers along approach, metres.
    """
    outer = half + FINGER_THICKNESS
    sides = [(-outer, -half), (half, outer), (-outer, outer)]
    ends = [(FINGER_BACK, tips), (FINGER_BACK, tips), (SLAB_BACK, np.full_like(tips, FINGER_BACK))]
    level = np.full_like(half, HALF_HEIGHT)
    return [
        (
            np.stack([np.full_like(half, back), inner, -level], axis=1),
            np.stack([front, outer, level], axis=1),
        )
        for (back, front), (inner, outer) in zip(ends, sides, strict=True)
    ]


def _held(
    points: Array, origin: Array, candidates: Mask, half: Singles, grow: float
) -> Iterator[tuple[Indices, int, Indices, Indices, Mask]]:
    """Yield, angle by angle, the points in the candidates' boxes grown by `grow` metres.

    Yields view (k,), angle, depth (k,), point (k,) and the mask (k,) of points in the exact boxes.
    """
    views = np.flatnonzero(candidates.any(axis=(1, 2)))
    if not len(views) or not len(points):
        return
    view, point, q = _near_gripper(points - origin, views, half, candidates, grow)
    wanted = np.asarray(candidates.any(axis=2))  # (300, 12)
    turns = np.stack([np.cos(IN_PLANE_ANGLES), np.sin(IN_PLANE_ANGLES)], 1).astype(np.float32)
    for angle, (cosine, sine) in enumerate(turns):
        level = np.abs(cosine * q[2] - sine * q[1])
        near = np.flatnonzero((level < HALF_HEIGHT + grow) & wanted[view, angle])
        side = np.abs(cosine * q[1, near] + sine * q[2, near])[:, None]
        along, opening = q[0, near, None], half[view[near], angle]
        row, depth = np.nonzero(_inside(along, side, opening, grow) & candidates[view[near], angle])
        picked = near[row]
        held = np.ones(len(row), np.bool_)
        if grow:
            held = _inside(along, side, opening, 0.0)[row, depth] & (level[picked] < HALF_HEIGHT)
        yield view[picked], angle, depth, point[picked], held


def _near_gripper(
    around: Array, views: Indices, half: Singles, candidates: Mask, grow: float
) -> tuple[Indices, Indices, Singles]:
    """Return view (k,), index (k,) and coordinates (3, k) at angle 0 of points near any box."""
    # Bounds per view for all angles: distances from the approach line, and reach along it.
    inner = np.where(candidates, half, np.inf).min(axis=(1, 2))[views, None] - grow
    outer = np.where(candidates, half, 0.0).max(axis=(1, 2))[views, None] + FINGER_THICKNESS + grow
    outer_squared = (outer**2 + (HALF_HEIGHT + grow) ** 2).astype(np.float32)
    tips = np.where(candidates, GRASP_DEPTHS, 0.0).max(axis=(1, 2))[views, None].astype(np.float32)
    points = around.astype(np.float32)
    square = np.einsum("ni,ni->n", points, points)
    farthest = max(GRASP_DEPTHS.max(), -SLAB_BACK) + grow
    near = np.flatnonzero(square < outer_squared.max() + farthest**2)
    points, square = points[near], square[near]
    frames = view_rotations(angles=np.zeros(1))[views, 0]
    along = frames[:, :, 0] @ points.T  # (v, n)
    away = square - along**2  # squared distance from the approach line
    reached = (along > SLAB_BACK - grow) & (along < tips + grow) & (away < outer_squared)
    inner_squared = np.maximum(inner, 0.0).astype(np.float32) ** 2
    reached &= (along < FINGER_BACK + grow) | (away > 0.999 * inner_squared)
    row, sample = np.nonzero(reached)
    across = np.einsum("kij,ki->jk", frames[row, :, 1:], points[sample])
    return views[row], near[sample], np.concatenate([along[row, sample][None], across])


def _inside(along: Singles, side: Singles, half: Singles, grow: float) -> Mask:
    """Return the mask (k, 4) of points `along`, `side` (k, 1) in the boxes of half openings."""
    back, front = np.float32(FINGER_BACK + grow), (GRASP_DEPTHS + grow).astype(np.float32)
    finger = (along > FINGER_BACK - grow) & (along < front) & (side > half - np.float32(grow))
    slab = (along > np.float32(SLAB_BACK - grow)) & (along < back)
    return (finger | slab) & (side < half + np.float32(FINGER_THICKNESS + grow))


def hits_plane(width: Floats, normal: Array, height: Array) -> Mask:
    """Return the mask (p, 300, 12, 4) of candidates with a gripper that reaches below a plane.

    `width`: (p, 300, 12, 4) openings, metres; `normal`: (3,) unit, up, object frame; `height`: (p,)
    heights of the grasp points above the plane, metres.
    """
    # Slab and fingers are equally high, so their lowest corner is the corner of their common box.
    up = np.einsum("i,vaij->jva", normal, view_rotations())[..., None]  # (3, 300, 12, 1)
    outer = 0.5 * width + FINGER_THICKNESS
    lowest = np.minimum(SLAB_BACK * up[0], GRASP_DEPTHS * up[0]) - HALF_HEIGHT * np.abs(up[2])
    lowest = lowest - outer * np.abs(up[1])
    return np.asarray(height[:, None, None, None] + lowest < 0.0)
