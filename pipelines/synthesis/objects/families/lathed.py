"""Families of objects turned on a lathe: continuous rotation symmetry about z, or a ball."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from pipelines.array_types import Array
from pipelines.synthesis.objects.revolved import SEGMENTS, hollow_lathe, lathe, pipe, torus
from pipelines.synthesis.objects.shape import Rng, Shape, revolution, sphere
from pipelines.synthesis.objects.solids import Solid, ball, lump, rounded_polyline


def rounded_lathe(
    points: ArrayLike, radius: float = 0.003, slabs: int = 4, segments: int = SEGMENTS
) -> Solid:
    """Return the solid of revolution of a polyline (radius, height) with rounded corners."""
    return lathe(rounded_polyline(points, radius), segments, slabs)


def smooth(heights: ArrayLike, radii: ArrayLike, count: int = 24) -> Array:
    """Return a profile through (radius, height) pairs without overshoot, closed on the axis."""
    z = np.linspace(np.min(heights), np.max(heights), count)
    r = PchipInterpolator(np.asarray(heights, float), np.asarray(radii, float))(z)
    return np.concatenate([[(0.0, z[0])], np.column_stack([r, z]), [(0.0, z[-1])]])


def can(rng: Rng) -> Shape:
    """Tins and tubs: a cylinder with rounded edges, some with a rim at both ends."""
    r, h = rng.uniform(0.018, 0.045), rng.uniform(0.03, 0.15)
    if rng.uniform() < 0.5:
        corners = [(0, 0), (r, 0), (r, h), (0, h)]
    else:
        lip, dip = 0.003, 0.002
        half = [(0, dip), (r - lip, dip), (r - lip, 0), (r, 0), (r, lip), (r - 0.001, 2 * lip)]
        corners = [*half, *((x, h - z) for x, z in reversed(half))]
    return Shape(rounded_lathe(np.array(corners) - [0, h / 2], 0.0015), revolution(level=True))


def bottle(rng: Rng) -> Shape:
    """Bottles: body, shoulder, neck and cap."""
    r, h = rng.uniform(0.022, 0.042), rng.uniform(0.12, 0.22)
    neck, cap = r * rng.uniform(0.3, 0.55), rng.uniform(0.012, 0.03)
    shoulder, waist = h * rng.uniform(0.5, 0.75), r * rng.uniform(0.82, 1.0)
    body = smooth(
        [0, 0.06 * h, 0.3 * h, shoulder, shoulder + 0.15 * h, h],
        [0.92 * r, r, waist, r, 1.05 * neck, neck],
    )
    low, high, wide = h - 0.002, h + cap, 1.2 * neck
    lid = rounded_lathe([(0, low), (wide, low), (wide, high), (0, high)])
    return Shape(lathe(body, slabs=6) | lid, revolution())


def jar(rng: Rng) -> Shape:
    """Jars: a wide body under a slightly wider or narrower lid."""
    r, h, lid = rng.uniform(0.022, 0.045), rng.uniform(0.04, 0.12), rng.uniform(0.01, 0.025)
    lid_radius, neck = r * rng.uniform(0.75, 1.06), h * 0.86
    corners = [(0, 0), (r, 0), (r, neck), (0.8 * lid_radius, h), (lid_radius, h + 0.001)]
    corners += [(lid_radius, h + lid), (0, h + lid)]
    return Shape(rounded_lathe(corners, 0.004), revolution())


def bowl(rng: Rng) -> Shape:
    """Bowls: shallow vessels with a foot."""
    r, h, wall = rng.uniform(0.05, 0.085), rng.uniform(0.035, 0.07), rng.uniform(0.003, 0.006)
    foot, power = r * rng.uniform(0.35, 0.6), rng.uniform(0.35, 0.65)
    t = np.linspace(0.0, 1.0, 16)
    outer = np.column_stack([foot + (r - foot) * t**power, h * t])
    inner = np.column_stack([foot + (r - foot) * t**power - wall, wall + (h - wall) * t])
    outline = np.concatenate([[(0, 0)], outer]), np.concatenate([inner[::-1], [(0, wall)]])
    return Shape(hollow_lathe(*outline), revolution())


def vessel(radius: float, height: float, taper: float, wall: float) -> Solid:
    """Return an open cup; `taper`: radius of the foot over radius of the rim."""
    foot, floor = radius * taper, 1.5 * wall
    outer = rounded_polyline([(0, 0), (foot, 0), (radius, height)], 0.005)
    slope = (radius - foot) / height
    inner = [(radius - wall, height), (foot + slope * floor - wall, floor), (0, floor)]
    return hollow_lathe(outer, rounded_polyline(inner, 0.005))


def cup(rng: Rng) -> Shape:
    """Cups and beakers without a handle."""
    r, h = rng.uniform(0.028, 0.045), rng.uniform(0.05, 0.12)
    solid = vessel(r, h, rng.uniform(0.65, 1.0), rng.uniform(0.002, 0.004))
    return Shape(solid, revolution())


def plate(rng: Rng) -> Shape:
    """Plates and saucers: flat, raised at the rim."""
    r, h, wall = rng.uniform(0.06, 0.1), rng.uniform(0.012, 0.025), rng.uniform(0.003, 0.005)
    foot = r * rng.uniform(0.5, 0.7)
    outer = rounded_polyline([(0, 0), (foot, 0), (r, h)], 0.01)
    inner = rounded_polyline([(r - wall, h), (foot - wall, wall), (0, wall)], 0.01)
    return Shape(hollow_lathe(outer, inner), revolution())


def sphere_ball(rng: Rng) -> Shape:
    """Balls."""
    return Shape(ball(rng.uniform(0.018, 0.045)), sphere())


def dimpled_ball(rng: Rng) -> Shape:
    """Golf and massage balls: dimples a hundredth of the radius deep."""
    waves = [(12.0 * axis, 0.004, 0.0) for axis in np.eye(3)]
    return Shape(lump(rng.uniform(0.018, 0.042), (1, 1, 1), waves, 112), sphere(error=0.02))


def fruit(rng: Rng) -> Shape:
    """Pears, apples, lemons, eggs."""
    r, h = rng.uniform(0.025, 0.04), rng.uniform(0.05, 0.1)
    waist = r * rng.uniform(0.5, 0.95)
    middle, z = waist / r, [0, 0.03, 0.12, 0.35, 0.7, 0.9, 0.98, 1.0]
    radii = [0, 0.35, 0.75, 1, middle, 0.65 * middle, 0.25, 0]
    profile = smooth(np.array(z) * h, np.array(radii) * r, 36)
    return Shape(lathe(profile[1:-1], slabs=5), revolution())


def marker(rng: Rng) -> Shape:
    """Markers, pens, lipsticks: slim, with a cap."""
    r, h = rng.uniform(0.006, 0.014), rng.uniform(0.09, 0.16)
    cap, tip = h * rng.uniform(0.25, 0.4), r * rng.uniform(0.4, 0.9)
    corners = [(0, 0), (0.9 * r, 0), (0.9 * r, h - cap), (r, h - cap), (r, h - 0.01), (tip, h)]
    return Shape(rounded_lathe([*corners, (0, h)], 0.001), revolution())


def capsule(rng: Rng) -> Shape:
    """Capsules and rolls with round ends."""
    r, h = rng.uniform(0.012, 0.035), rng.uniform(0.02, 0.1)
    angle = np.linspace(0.0, np.pi / 2, 12)
    cap = np.column_stack([r * np.sin(angle), -h / 2 - r * np.cos(angle)])
    cap[0, 0] = 0.0
    return Shape(lathe(np.concatenate([cap, (cap * [1, -1])[::-1]])), revolution(level=True))


def dumbbell(rng: Rng) -> Shape:
    """Dumbbells and reels: a bar between two discs."""
    r, h = rng.uniform(0.02, 0.04), rng.uniform(0.06, 0.15)
    bar, disc = r * rng.uniform(0.3, 0.6), h * rng.uniform(0.15, 0.3)
    half = [(0, 0), (r, 0), (r, disc), (bar, disc + 0.003)]
    corners = [*half, *((x, h - z) for x, z in reversed(half))]
    solid = rounded_lathe(np.array(corners) - [0, h / 2], 0.004, slabs=5)
    return Shape(solid, revolution(level=True))


def tube(rng: Rng) -> Shape:
    """Rolls of tape, napkin rings, pipes."""
    r, h = rng.uniform(0.02, 0.05), rng.uniform(0.012, 0.09)
    return Shape(pipe(r, r * rng.uniform(0.55, 0.88), h, 0.0015), revolution(level=True))


def ring(rng: Rng) -> Shape:
    """Rings with a round or flattened section (doughnuts, bracelets)."""
    r, thick = rng.uniform(0.025, 0.05), rng.uniform(0.006, 0.014)
    angle = np.linspace(0.0, 2 * np.pi, 20, endpoint=False)
    high = rng.uniform(0.7, 1.6) * thick
    section = np.column_stack([thick * np.cos(angle), high * np.sin(angle)])
    return Shape(torus(r, section), revolution(level=True))


def cone(rng: Rng) -> Shape:
    """Cones and frustums."""
    r, h = rng.uniform(0.025, 0.045), rng.uniform(0.05, 0.12)
    top = r * rng.uniform(0.15, 0.6)
    return Shape(rounded_lathe([(0, 0), (r, 0), (top, h), (0, h)], 0.003), revolution())


def goblet(rng: Rng) -> Shape:
    """Stemmed glasses, as solid as an hourglass."""
    r, h = rng.uniform(0.025, 0.04), rng.uniform(0.1, 0.17)
    foot, stem = r * rng.uniform(0.7, 1.0), rng.uniform(0.005, 0.009)
    z = np.array([0, 0.03, 0.08, 0.3, 0.42, 0.65, 0.9, 1.0]) * h
    radii = [foot, 0.95 * foot, 2 * stem, stem, 1.4 * stem, 0.95 * r, r, 0.9 * r]
    return Shape(lathe(smooth(z, radii, 36), slabs=8), revolution())


def pawn(rng: Rng) -> Shape:
    """Chess pieces, skittles, light bulbs."""
    r, h = rng.uniform(0.018, 0.035), rng.uniform(0.07, 0.16)
    head = r * rng.uniform(0.5, 0.95)
    z = np.array([0, 0.06, 0.15, 0.45, 0.6, 0.68, 0.82, 0.95, 0.99, 1.0]) * h
    body, top = np.array([1, 1, 0.7, 0.38, 0.34]) * r, np.array([0.6, 1, 0.6, 0.25, 0.01]) * head
    return Shape(lathe(smooth(z, [*body, *top], 40), slabs=8), revolution())
