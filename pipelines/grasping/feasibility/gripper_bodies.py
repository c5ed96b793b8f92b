"""Compiled loops behind `collision`: the bodies of a gripper against points, grasp by grasp.

A gripper is two fingers and a palm, boxes in the grasp frame (approach, closing, binormal). It is
symmetric along closing and binormal, so a point's distance counts there, not its side. All is
single precision, metres. `bounds` are those of `Gripper`, `cells` those of `Obstacles`: points
(3, n), cube by cube; the number of measured points that each represents (n,); start and end of the
points of each cube (c + 1,); centres (3, c) and radii (c,) of balls about the points of a cube.
"""

import numpy as np

from pipelines.array_types import Array, Counts, Mask, Singles, SingleVector
from pipelines.geometry.numerics.compiled import compiled
from pipelines.grasping.obstacles import Cells

Single = np.float32
Quadruple = tuple[Single, Single, Single, Single]
GraspFrame = tuple[Quadruple, Quadruple, Quadruple]
Bodies = tuple[Quadruple, Quadruple]  # fingers, palm


@compiled
def frames_about(rotation: Array, translation: Array, center: Array) -> Singles:
    """Return matrices (k, 3, 4) into the frames of k grasps, from coordinates about `center` (3,).

    `rotation`: (k, 3, 3). `translation`: (k, 3) metres.
    """
    frames = np.empty((len(rotation), 3, 4), np.float32)
    for k in range(len(rotation)):
        for axis in range(3):
            origin = 0.0
            for i in range(3):
                frames[k, axis, i] = rotation[k, i, axis]
                origin += (translation[k, i] - center[i]) * rotation[k, i, axis]
            frames[k, axis, 3] = -origin
    return frames


@compiled
def points_met(
    frames: Singles, bounds: Singles, margin: Single, allowed: int, cells: Cells
) -> tuple[Mask, Singles]:
    """Return which of k grasps have too many points in the bodies, and the enclosed heights.

    Args:
        frames: (k, 3, 4) into each grasp's frame.
        bounds: (k, 9) of the bodies.
        margin: metres by which the bodies are enlarged.
        allowed: number of points that the bodies may contain.
        cells: the points.

    Returns:
        (k,) whether the bodies contain more than `allowed` points; (k,) metres that points between
        the fingers reach in from the tips' line, 0 for colliding grasps.
    """
    blocked, enclosed = np.empty(len(frames), np.bool_), np.zeros(len(frames), np.float32)
    near = np.empty(len(cells[4]), np.bool_)
    for k in range(len(frames)):
        frame = _frame(frames[k])
        blocked[k] = _is_blocked(frame, bounds[k], margin, allowed, cells, near)
        if not blocked[k]:
            enclosed[k] = _enclosed(frame, bounds[k], cells, near)
    return blocked, enclosed


@compiled
def first_free_grasps(
    frames: Singles,
    bounds: Singles,
    margin: Single,
    allowed: int,
    cells: Cells,
    stability: Array,
    wanted: tuple[float, float, int],
) -> tuple[Counts, Singles]:
    """Return indices (f,) of free grasps that enclose enough, and enclosed heights (f,), metres.

    The most stable grasps, by `stability` (k,), come first. `wanted`: metres to enclose, the share
    of the first free grasp's stability that other grasps need, and the most grasps to return. The
    other arguments are those of `points_met`.
    """
    least, share, most = wanted
    found, enclosed = np.empty(len(frames), np.int64), np.empty(len(frames), np.float32)
    near, count = np.empty(len(cells[4]), np.bool_), 0
    for k in range(len(frames)):
        if count == most or (count > 0 and stability[k] < share * stability[found[0]]):
            break
        frame = _frame(frames[k])
        if _is_blocked(frame, bounds[k], margin, allowed, cells, near):
            continue
        enclosed[count] = _enclosed(frame, bounds[k], cells, near)
        if enclosed[count] >= least:
            found[count] = k
            count += 1
    return found[:count], enclosed[:count]


@compiled
def nearest_gaps(frames: Singles, bounds: Singles, cap: Single, cells: Cells) -> Singles:
    """Return the distance (k,) of the bodies of k grasps from the nearest point, at most `cap`.

    Arguments are those of `points_met`.
    """
    points, _, start, center, radius = cells
    nearest, least = np.empty(len(frames), np.float32), np.empty(len(radius), np.float32)
    for k in range(len(frames)):
        frame, bodies = _frame(frames[k]), _bodies(bounds[k], Single(0.0))
        inner, first, gap = bounds[k, 6], 0, cap
        for c in range(len(radius)):
            place = _local(frame, center[0, c], center[1, c], center[2, c])
            least[c] = np.sqrt(_gap(bodies, inner, place)) - radius[c]
        for c in range(len(radius)):
            first = c if least[c] < least[first] else first
        for turn in range(min(len(radius), 1) + len(radius)):
            c = first if turn == 0 else turn - 1  # with the nearest cube first, few others remain
            if least[c] >= gap:
                continue
            squared = gap * gap
            for n in range(start[c], start[c + 1]):
                place = _local(frame, points[0, n], points[1, n], points[2, n])
                squared = min(squared, _gap(bodies, inner, place))
            gap = np.sqrt(squared)
        nearest[k] = gap
    return nearest


@compiled
def points_reach(frames: Singles, bounds: Singles, allowed: int, cells: Cells) -> Singles:
    """Return how far points between the open fingers of k grasps are from the midpoint, metres.

    (k, 2): against the closing axis, and along it; 0 without such points. The `allowed` outermost
    measured points of a side do not count. The other arguments are those of `points_met`.
    """
    points, count, start, center, radius = cells
    reach = np.empty((len(frames), 2), np.float32)
    for k in range(len(frames)):
        frame, closing = _frame(frames[k]), frames[k, 1]
        back, tip, half, inner = bounds[k, 0], bounds[k, 1], bounds[k, 4], bounds[k, 6]
        outermost = np.zeros((2, allowed + 1), np.float32)
        for c in range(len(radius)):
            along, across, height = _local(frame, center[0, c], center[1, c], center[2, c])
            if max(back - along, along - tip, across - inner, height - half) > radius[c]:
                continue
            for n in range(start[c], start[c + 1]):
                x, y, z = points[0, n], points[1, n], points[2, n]
                along, across, height = _local(frame, x, y, z)
                if (back < along) & (along < tip) & (across < inner) & (height < half):
                    ahead = closing[0] * x + closing[1] * y + closing[2] * z + closing[3] > 0
                    _insert(outermost[int(ahead)], across, count[n])
        reach[k, 0], reach[k, 1] = outermost[0, allowed], outermost[1, allowed]
    return reach


@compiled
def _insert(largest: Singles, value: Single, times: int) -> None:
    """Insert `value`, `times` times, into `largest` (m,), which descends and keeps its length."""
    for _ in range(min(times, len(largest))):
        place = len(largest) - 1
        if value <= largest[place]:
            return
        while place > 0 and largest[place - 1] < value:
            largest[place] = largest[place - 1]
            place -= 1
        largest[place] = value


@compiled
def _is_blocked(
    frame: GraspFrame, bounds: Singles, margin: Single, allowed: int, cells: Cells, near: Mask
) -> bool:
    """Return whether the bodies, enlarged by `margin`, contain more than `allowed` points.

    If not, `near` (c,) is set to the cubes with possible points in a body or between the fingers.
    """
    points, count, start, center, radius = cells
    bodies, inner, met = _bodies(bounds, margin), bounds[6] - margin, 0
    for c in range(len(radius)):
        place = _local(frame, center[0, c], center[1, c], center[2, c])
        near[c] = _gap(bodies, Single(0.0), place) <= radius[c] * radius[c]
    for c in range(len(radius)):
        if not near[c]:
            continue
        # Unsigned indices never count from an array's end, so the loop is vectorised.
        for n in range(np.uint64(start[c]), np.uint64(start[c + 1])):
            place = _local(frame, points[0, n], points[1, n], points[2, n])
            met += count[n] * _is_inside(bodies, inner, place)
        if met > allowed:
            return True
    return False


@compiled
def _enclosed(frame: GraspFrame, bounds: Singles, cells: Cells, near: Mask) -> Single:
    """Return the enclosed height of points between the fingers, metres, from cubes `near` (c,)."""
    points, _, start, center, radius = cells
    back, tip, half, inner = bounds[0], bounds[1], bounds[4], bounds[6]
    deepest = Single(0.0)
    for c in range(len(radius)):
        if not near[c]:
            continue
        along, across, height = _local(frame, center[0, c], center[1, c], center[2, c])
        if max(along - (tip - deepest), across - inner, height - half) > radius[c]:
            continue
        for n in range(start[c], start[c + 1]):
            along, across, height = _local(frame, points[0, n], points[1, n], points[2, n])
            if (back < along) & (along < tip) & (across < inner) & (height < half):
                deepest = max(deepest, tip - along)
    return deepest


@compiled
def _frame(m: Singles) -> GraspFrame:
    """Return the rows of the matrix `m` (3, 4) as numbers, which stay in registers."""
    first = (m[0, 0], m[0, 1], m[0, 2], m[0, 3])
    second = (m[1, 0], m[1, 1], m[1, 2], m[1, 3])
    return first, second, (m[2, 0], m[2, 1], m[2, 2], m[2, 3])


@compiled
def _bodies(b: Singles, m: Single) -> Bodies:
    """Return fingers and palm, each (back, tip, half, outer), of bounds `b`, enlarged by `m`."""
    fingers = (b[0] - m, b[1] + m, b[4] + m, b[7] + m)
    return fingers, (b[2] - m, b[3] + m, b[5] + m, b[8] + m)


@compiled
def _local(frame: GraspFrame, x: Single, y: Single, z: Single) -> SingleVector:
    """Return a point's position along approach, and distances along closing and binormal."""
    first, second, third = frame
    along = first[0] * x + first[1] * y + first[2] * z + first[3]
    across = second[0] * x + second[1] * y + second[2] * z + second[3]
    return along, abs(across), abs(third[0] * x + third[1] * y + third[2] * z + third[3])


@compiled
def _is_inside(bodies: Bodies, inner: Single, place: SingleVector) -> int:
    """Return 1 for a point inside a body, else 0; `inner`: inner face of a finger along closing."""
    along, across, height = place
    back, tip, half, outer = bodies[0]
    finger = (along > back) & (along < tip) & (height < half) & (across > inner) & (across < outer)
    back, tip, half, outer = bodies[1]
    palm = (along > back) & (along < tip) & (height < half) & (across < outer)
    return int(finger or palm)


@compiled
def _gap(bodies: Bodies, inner: Single, place: SingleVector) -> Single:
    """Return the squared distance to the nearest body; `inner` 0 fills the space between."""
    along, across, height = place
    back, tip, half, outer = bodies[0]
    a = max(back - along, along - tip, Single(0.0))
    b = max(inner - across, across - outer, Single(0.0))
    c = max(height - half, Single(0.0))
    finger = a * a + b * b + c * c
    back, tip, half, outer = bodies[1]
    a = max(back - along, along - tip, Single(0.0))
    b = max(across - outer, Single(0.0))
    c = max(height - half, Single(0.0))
    return min(finger, a * a + b * b + c * c)
