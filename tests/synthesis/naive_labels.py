"""Grasp labels computed slowly and plainly from triangles, one candidate at a time.

The module shares no code with the package: lines against all triangles by Moeller and Trumbore,
boxes by clipping every triangle, frames from the formulas of the layout.
"""

import numpy as np

MARGIN, WIDEST = 0.005, 0.06  # metres: free line behind a contact; half of the widest opening


def gripper_frame(view, angle):
    """Columns approach, closing, approach x closing; in single precision, as in the layout."""
    f = np.float32
    z = (f(2) * f(view) + f(1)) / f(300) - f(1)
    turn = f(2) * f(view) * f(np.pi) * f((np.sqrt(5) - 1) / 2)
    radius = np.sqrt(f(1) - z**2)
    x = -np.array([radius * np.cos(turn), radius * np.sin(turn), z])
    y = np.array([-x[1], x[0], 0])
    y = y / np.linalg.norm(y)
    x = x / np.linalg.norm(x)
    t = angle * np.pi / 12
    twist = np.array([[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]])
    return (np.stack([x, y, np.cross(x, y)], axis=1) @ twist).astype(f).astype(float)


def line_hits(triangles, start, direction):
    """Signed distance along the line and cosine to the triangle's normal, of every crossing."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    p = np.cross(direction, c - a)
    determinant = (p * (b - a)).sum(axis=1)
    flat = np.abs(determinant) < 1e-18
    scale = 1 / np.where(flat, 1, determinant)
    u = (p * (start - a)).sum(axis=1) * scale
    q = np.cross(start - a, b - a)
    v = (q @ direction) * scale
    hit = ~flat & (u >= 0) & (v >= 0) & (u + v <= 1)
    normal = np.cross(b - a, c - a)[hit]
    cosine = normal @ direction / np.linalg.norm(normal, axis=1)
    return ((q * (c - a)).sum(axis=1) * scale)[hit], cosine


def contact(hits, half, side):
    """Distance and cosine of the surface first met by the finger at `half` on `side`, or None."""
    on_side = [(side * s, side * c) for s, c in zip(*hits, strict=True) if 0 <= side * s <= half]
    if not on_side:
        return None
    distance, cosine = max(on_side)
    return (distance, cosine) if cosine > 0 else None  # None: the finger starts inside


def openings(hits):
    """Half openings that leave MARGIN behind both contacts, with their friction; smallest first."""
    found = []
    for half in sorted({min(abs(s) + MARGIN, WIDEST) for s in hits[0] if abs(s) <= WIDEST}):
        touched = [contact(hits, half, side) for side in (-1, 1)]
        if None in touched:
            continue
        if half < WIDEST and max(touched)[0] > half - MARGIN + 1e-12:
            continue
        found.append((half, max(np.tan(np.arccos(min(1, cosine))) for _, cosine in touched)))
    return found


def clip(polygon, axis, bound, sign):
    """The part of a polygon where `sign * x[axis] >= sign * bound`."""
    kept = []
    for p, q in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        inside_p, inside_q = (sign * (r[axis] - bound) >= 0 for r in (p, q))
        if inside_p:
            kept.append(p)
        if inside_p != inside_q:
            kept.append(p + (bound - p[axis]) / (q[axis] - p[axis]) * (q - p))
    return kept


def meets(triangle, low, high):
    """Return whether a part of the triangle is strictly inside the box."""
    polygon = list(triangle)
    for axis in range(3):
        for bound, sign in ((low[axis], 1), (high[axis], -1)):
            polygon = clip(polygon, axis, bound, sign)
            if not polygon:
                return False
    middle = np.mean(polygon, axis=0)
    return bool(((middle > low + 1e-12) & (middle < high - 1e-12)).all())


def collides(triangles, origin, frame, half, depth):
    """Return whether any triangle is in the fingers or the slab behind them."""
    local = (triangles - origin) @ frame
    for corners in (
        ([-0.02, half, -0.01], [depth, half + 0.01, 0.01]),
        ([-0.02, -half - 0.01, -0.01], [depth, -half, 0.01]),
        ([-0.03, -half - 0.01, -0.01], [-0.02, half + 0.01, 0.01]),
    ):
        low, high = np.array(corners)
        near = ((local.max(axis=1) > low) & (local.min(axis=1) < high)).all(axis=1)
        if any(meets(triangle, low, high) for triangle in local[near]):
            return True
    return False


def label(triangles, origin, view, angle, depth_index):
    """Friction on the grid (-1: none), width and collision of one candidate."""
    frame, depth = gripper_frame(view, angle), 0.01 * (depth_index + 1)
    hits = line_hits(triangles, origin + depth * frame[:, 0], frame[:, 1])
    found = openings(hits)
    answer = (-1.0, 2 * found[0][0] if found else 0.0, True)
    for half, friction in found:
        grid = [k / 10 for k in range(1, 11) if k / 10 >= friction]
        if not grid:
            continue
        width = float(np.float32(2 * half))
        collision = collides(triangles, origin, frame, width / 2, depth)
        if not collision:
            return grid[0], width, False
        if answer[0] < 0:
            answer = (grid[0], width, True)
    return answer
