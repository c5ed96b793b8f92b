"""First triangles on rays: by Embree if it is installed, else by a tree of boxes.

Embree has no wheel for ARM Linux. Embree searches in single precision, the tree in double: results
differ where a ray passes an edge within a ten-millionth of the scene's size.
"""

from typing import Any

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.numerics.compiled import compiled

try:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene
except ImportError:  # `doctor` reports it
    EmbreeScene = None

LEAF = 4  # triangles of a node that is not split
STACK = 64  # waiting nodes; no median tree that fits into memory is as deep
EDGE = 1e-12  # of a triangle's sides: a ray between two triangles hits one
WIDER = 1.0 + 1e-15  # factor of the distance to a box's far side, for rounding
TINY = 1e-300  # replaces zero in a direction


class EmbreeSearch:
    """Embree's search among `triangles` (t, 3, 3) in single precision, finest near the origin.

    Rays start at `origins` (r, 3) along `directions` (r, 3).
    """

    def __init__(self, triangles: Array) -> None:
        self._scene = EmbreeScene()
        # Embree refers to the mesh's buffers, so the buffers must live as long as the scene.
        self._mesh = TriangleMesh(self._scene, triangles.astype(np.float32))

    def first(self, origins: Array, directions: Array) -> tuple[Indices, Array]:
        """Return the first triangle (r,) of each ray, -1 for none, and its distance (r,).

        `origins`, `directions`: (r, 3) mesh frame.
        """
        found = self._run(origins, directions, output=1)
        triangle = np.where(found["geomID"] >= 0, found["primID"], -1).astype(np.int64)
        return triangle, found["tfar"].astype(np.float64)

    def any(self, origins: Array, directions: Array) -> Mask:
        """Return (r,) whether each ray hits anything; arguments as in `first`."""
        return np.asarray(self._run(origins, directions, query="OCCLUDED") >= 0)

    def _run(self, origins: Array, directions: Array, **options: object) -> Any:  # noqa: ANN401
        return self._scene.run(origins.astype(np.float32), directions.astype(np.float32), **options)


class TreeSearch:
    """A search among `triangles` (t, 3, 3) by a tree of boxes, some times slower than Embree.

    A node is split at the median of its triangles along the axis of their largest extent.
    """

    def __init__(self, triangles: Array) -> None:
        fixed = np.ascontiguousarray(triangles).view()
        fixed.flags.writeable = False  # as arrays of meshes: the loop is compiled for one type
        self._tree = _built(fixed)
        self._triangles = np.ascontiguousarray(triangles[self._tree[0]])

    def first(self, origins: Array, directions: Array) -> tuple[Indices, Array]:
        """Return the first triangle (r,) of each ray, -1 for none, and its distance (r,).

        `origins`, `directions`: (r, 3) mesh frame.
        """
        return self._cast(origins, directions, any_hit=False)

    def any(self, origins: Array, directions: Array) -> Mask:
        """Return (r,) whether each ray hits anything; arguments as in `first`."""
        return np.asarray(self._cast(origins, directions, any_hit=True)[0] >= 0)

    def _cast(self, origins: Array, directions: Array, any_hit: bool) -> tuple[Indices, Array]:
        o, d = (np.ascontiguousarray(rays, np.float64) for rays in (origins, directions))
        return _cast(self._triangles, self._tree, o, d, any_hit)


def has_embree() -> bool:
    """Return whether rays are cast by Embree."""
    return EmbreeScene is not None


def ray_search(triangles: Array) -> EmbreeSearch | TreeSearch:
    """Return a search among `triangles` (t, 3, 3)."""
    return EmbreeSearch(triangles) if has_embree() else TreeSearch(triangles)


@compiled
def _built(triangles: Array) -> tuple[Indices, Array, Indices]:
    """Return the tree of `triangles` (t, 3, 3): an order (t,), boxes (n, 2, 3), and nodes (n, 2).

    A node is (first triangle in the order, number of triangles), or (first of two children, 0).
    """
    count = len(triangles)
    low, high = np.empty((count, 3)), np.empty((count, 3))
    for n in range(count):
        for axis in range(3):
            a, b, c = triangles[n, 0, axis], triangles[n, 1, axis], triangles[n, 2, axis]
            low[n, axis], high[n, axis] = min(a, b, c), max(a, b, c)
    middle = low + high
    order = np.arange(count)
    boxes, nodes = np.empty((2 * count, 2, 3)), np.zeros((2 * count, 2), np.int64)
    waiting = np.zeros((STACK, 3), np.int64)
    waiting[0, 2], depth, made = count, 1, 1
    while depth:
        depth -= 1
        node, start, end = waiting[depth, 0], waiting[depth, 1], waiting[depth, 2]
        part = order[start:end]
        widest, axis = -1.0, 0
        for k in range(3):
            boxes[node, 0, k], boxes[node, 1, k] = low[part, k].min(), high[part, k].max()
            spread = middle[part, k].max() - middle[part, k].min()
            if spread > widest:
                widest, axis = spread, k
        if end - start <= LEAF:
            nodes[node, 0], nodes[node, 1] = start, end - start
            continue
        order[start:end] = part[np.argsort(middle[part, axis], kind="mergesort")]
        nodes[node, 0] = made
        half = (start + end) // 2
        for first, last in ((start, half), (half, end)):
            waiting[depth, 0], waiting[depth, 1], waiting[depth, 2] = made, first, last
            depth, made = depth + 1, made + 1
    return order, boxes[:made].copy(), nodes[:made].copy()


@compiled
def _entry(box: Array, origin: Array, inverse: Array, reach: float) -> float:
    """Return the distance at which a ray enters `box` (2, 3); inf if not before `reach`."""
    near, far = 0.0, reach
    for k in range(3):
        one, other = (box[0, k] - origin[k]) * inverse[k], (box[1, k] - origin[k]) * inverse[k]
        near, far = max(near, min(one, other)), min(far, max(one, other) * WIDER)
    return near if near <= far else np.inf


@compiled
def _distance(corners: Array, origin: Array, along: Array) -> float:
    """Return the distance at which a ray crosses a triangle (3, 3); inf for a miss.

    By Möller and Trumbore; u and v are the barycentric coordinates of the crossing.
    """
    ax, ay, az = corners[0, 0], corners[0, 1], corners[0, 2]
    bx, by, bz = corners[1, 0] - ax, corners[1, 1] - ay, corners[1, 2] - az
    cx, cy, cz = corners[2, 0] - ax, corners[2, 1] - ay, corners[2, 2] - az
    dx, dy, dz = along[0], along[1], along[2]
    px, py, pz = dy * cz - dz * cy, dz * cx - dx * cz, dx * cy - dy * cx
    slope = bx * px + by * py + bz * pz
    if slope == 0.0:
        return np.inf
    sx, sy, sz = origin[0] - ax, origin[1] - ay, origin[2] - az
    u = (sx * px + sy * py + sz * pz) / slope
    qx, qy, qz = sy * bz - sz * by, sz * bx - sx * bz, sx * by - sy * bx
    v = (dx * qx + dy * qy + dz * qz) / slope
    if u < -EDGE or v < -EDGE or u + v > 1.0 + EDGE:
        return np.inf
    distance = (cx * qx + cy * qy + cz * qz) / slope
    return distance if distance > 0.0 else np.inf


@compiled
def _cast(
    triangles: Array,
    tree: tuple[Indices, Array, Indices],
    origins: Array,
    directions: Array,
    any_hit: bool,
) -> tuple[Indices, Array]:
    """Return the first triangle (r,) of each ray, -1 for none, and its distance (r,) or inf.

    Args:
        triangles: (t, 3, 3) in the tree's order.
        tree: the tree of `_built`.
        origins: (r, 3).
        directions: (r, 3), the unit of the distances.
        any_hit: stop at any hit triangle instead of the first.
    """
    order, boxes, nodes = tree
    found, distance = np.full(len(origins), -1), np.full(len(origins), np.inf)
    waiting, entries, inverse = np.empty(STACK, np.int64), np.empty(STACK), np.empty(3)
    for r in range(len(origins)):
        origin, along = origins[r], directions[r]
        for k in range(3):
            inverse[k] = 1.0 / (along[k] if abs(along[k]) > TINY else TINY)
        waiting[0], entries[0], depth = 0, _entry(boxes[0], origin, inverse, np.inf), 1
        while depth and not (any_hit and found[r] >= 0):
            depth -= 1
            node = waiting[depth]
            if entries[depth] > distance[r] or entries[depth] == np.inf:
                continue
            first, count = nodes[node, 0], nodes[node, 1]
            for n in range(first, first + count):
                here = _distance(triangles[n], origin, along)
                if here < distance[r]:
                    found[r], distance[r] = order[n], here
            if not count:
                one = _entry(boxes[first], origin, inverse, distance[r])
                other = _entry(boxes[first + 1], origin, inverse, distance[r])
                nearer = 0 if one <= other else 1  # and is on top of the stack
                waiting[depth], entries[depth] = first + 1 - nearer, max(one, other)
                waiting[depth + 1], entries[depth + 1] = first + nearer, min(one, other)
                depth += 2
    return found, distance
