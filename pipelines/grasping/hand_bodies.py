"""One hand against points, one after the other: compiled loops behind `collision`.

A hand is two fingers and a palm, boxes in its own frame (approach, closing, height), the same on
both sides of it: what counts along closing and height is how far off a point lies. All is single
precision, metres. `frames` and `bounds` are as `collision` makes them.
"""

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.compiled import compiled

Single = np.float32
Singles = NDArray[np.float32]
Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]
Row = tuple[Single, Single, Single, Single]
Frame = tuple[Row, Row, Row]
Hand = tuple[Row, Row]
Place = tuple[Single, Single, Single]


@compiled
def points_met(
    frames: Singles,
    bounds: Singles,
    margin: Single,
    allowed: int,
    points: Singles,
    count: Counts,
    start: Counts,
    centre: Singles,
    radius: Singles,
) -> tuple[Mask, Singles]:
    """Return which of k hands, blown up by `margin`, meet too much, and what the others enclose.

    Args:
        frames: (k, 3, 4) into each hand's frame.
        bounds: (k, 9) of its bodies.
        margin: metres.
        allowed: sum of `count`.
        points: (3, n), cube by cube.
        count: (n,) measured points that each stands for.
        start: (c + 1,) where a cube's points start and end.
        centre: (3, c) of balls about the points of a cube.
        radius: (c,).

    Returns:
        (k,) whether it meets more than `allowed`; (k,) metres that points between the fingers
        reach in from the tips' line, 0 where it does.
    """
    blocked, enclosed = np.zeros(len(frames), np.bool_), np.zeros(len(frames), np.float32)
    for k in range(len(frames)):
        frame, blown = _frame(frames[k]), _hand(bounds[k], margin)
        back, tip, half, inner = bounds[k, 0], bounds[k, 1], bounds[k, 4], bounds[k, 6]
        met, deepest = 0, Single(0.0)
        for c in range(len(radius)):
            place = _local(frame, centre[0, c], centre[1, c], centre[2, c])
            if _gap(blown, Single(0.0), place) > radius[c] * radius[c]:
                continue
            for n in range(start[c], start[c + 1]):
                place = _local(frame, points[0, n], points[1, n], points[2, n])
                met += count[n] * _bodies_at(blown, inner - margin, place)
            if met > allowed:
                break
            for n in range(start[c], start[c + 1]):
                along, across, third = _local(frame, points[0, n], points[1, n], points[2, n])
                if (back < along) & (along < tip) & (across < inner) & (third < half):
                    deepest = max(deepest, tip - along)
        blocked[k] = met > allowed
        enclosed[k] = Single(0.0) if blocked[k] else deepest
    return blocked, enclosed


@compiled
def nearest_gaps(
    frames: Singles,
    bounds: Singles,
    cap: Single,
    points: Singles,
    count: Counts,
    start: Counts,
    centre: Singles,
    radius: Singles,
) -> Singles:
    """Return (k,) metres from the bodies of k hands to the nearest point, at most `cap`.

    Arguments are those of `points_met`.
    """
    nearest = np.empty(len(frames), np.float32)
    for k in range(len(frames)):
        frame, hand = _frame(frames[k]), _hand(bounds[k], Single(0.0))
        gap, inner = cap, bounds[k, 6]
        for c in range(len(radius)):
            place = _local(frame, centre[0, c], centre[1, c], centre[2, c])
            if np.sqrt(_gap(hand, inner, place)) - radius[c] >= gap:
                continue
            squared = gap * gap
            for n in range(start[c], start[c + 1]):
                place = _local(frame, points[0, n], points[1, n], points[2, n])
                squared = min(squared, _gap(hand, inner, place))
            gap = np.sqrt(squared)
        nearest[k] = gap
    return nearest


@compiled
def _frame(m: Singles) -> Frame:
    """Return the rows of the matrix `m` (3, 4), as numbers: a loop holds these at hand."""
    first = (m[0, 0], m[0, 1], m[0, 2], m[0, 3])
    second = (m[1, 0], m[1, 1], m[1, 2], m[1, 3])
    return first, second, (m[2, 0], m[2, 1], m[2, 2], m[2, 3])


@compiled
def _hand(b: Singles, m: Single) -> Hand:
    """Return fingers (back, tip, half, outer) and palm likewise of bounds `b`, `m` blown up."""
    fingers = (b[0] - m, b[1] + m, b[4] + m, b[7] + m)
    return fingers, (b[2] - m, b[3] + m, b[5] + m, b[8] + m)


@compiled
def _local(frame: Frame, x: Single, y: Single, z: Single) -> Place:
    """Return where a point lies along approach, and how far off across closing and height."""
    first, second, third = frame
    along = first[0] * x + first[1] * y + first[2] * z + first[3]
    across = second[0] * x + second[1] * y + second[2] * z + second[3]
    return along, abs(across), abs(third[0] * x + third[1] * y + third[2] * z + third[3])


@compiled
def _bodies_at(hand: Hand, inner: Single, place: Place) -> int:
    """Return in how many bodies a point lies; `inner`: of a finger along closing."""
    along, across, third = place
    back, tip, half, outer = hand[0]
    finger = (along > back) & (along < tip) & (third < half) & (across > inner) & (across < outer)
    back, tip, half, outer = hand[1]
    palm = (along > back) & (along < tip) & (third < half) & (across < outer)
    return int(finger) + int(palm)


@compiled
def _gap(hand: Hand, inner: Single, place: Place) -> Single:
    """Return the squared distance to the nearest body; `inner` 0 counts what they close in on."""
    along, across, third = place
    back, tip, half, outer = hand[0]
    a = max(back - along, along - tip, Single(0.0))
    b = max(inner - across, across - outer, Single(0.0))
    c = max(third - half, Single(0.0))
    finger = a * a + b * b + c * c
    back, tip, half, outer = hand[1]
    a = max(back - along, along - tip, Single(0.0))
    b = max(across - outer, Single(0.0))
    c = max(third - half, Single(0.0))
    return min(finger, a * a + b * b + c * c)
