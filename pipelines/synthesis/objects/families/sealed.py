"""Families of the sealed benchmark, which no network is trained on and no decision is made with.

The families share no generator with the families of training: they are made of swept outlines,
lofts and superquadrics, from solids alone.
"""

from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, Manifold

from pipelines.array_types import Array
from pipelines.geometry.symmetry import RotationSymmetry
from pipelines.geometry.transforms import rotation_about
from pipelines.synthesis.objects.shape import (
    ORIGIN,
    Rng,
    Shape,
    mirror_axes,
    polygon_symmetries,
    revolution,
)
from pipelines.synthesis.objects.solids import (
    Solid,
    ball,
    bent_tube,
    box,
    hull,
    on_levels,
    prism,
    solid_of,
    tube_faces,
)


def _on_circle(count: int) -> Array:
    return np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)


def _loft(sections: Array, layers: int) -> Solid:
    """Return the solid between rings (k, n, 3), closed by flat ends; convex pieces in layers."""
    rings, sides = sections.shape[:2]
    vertices = np.concatenate([sections.reshape(-1, 3), sections[[0, -1]].mean(axis=1)])
    cuts = np.linspace(0, rings - 1, layers + 1).astype(int)
    pieces = [sections[a : b + 1].reshape(-1, 3) for a, b in pairwise(cuts)]
    return solid_of(vertices, tube_faces(rings, sides), pieces)


def superquadric(rng: Rng) -> Shape:
    """Pillows, lozenges, rounded blocks: superquadrics of three different half axes."""
    half = np.sort(rng.uniform([0.014, 0.024, 0.036], [0.02, 0.031, 0.06]))
    e1, e2 = rng.uniform(0.3, 1.4), rng.uniform(0.3, 1.4)
    points = np.array(Manifold.sphere(1.0, 88).to_mesh64().vert_properties)[:, :3]
    latitude, longitude = np.arcsin(np.clip(points[:, 2], -1, 1)), np.arctan2(*points[:, [1, 0]].T)

    def power(values: Array, exponent: float) -> Array:
        return np.sign(values) * np.abs(values) ** exponent

    level = power(np.cos(latitude), e1)
    shaped = np.column_stack(
        [
            level * power(np.cos(longitude), e2),
            level * power(np.sin(longitude), e2),
            power(np.sin(latitude), e1),
        ]
    )
    return Shape(hull(half[rng.permutation(3)] * shaped), mirror_axes("xyz"))


def lobed_knob(rng: Rng) -> Shape:
    """Star knobs and flowers: a wavy outline, extruded, on a stem."""
    lobes, h = int(rng.integers(3, 8)), rng.uniform(0.015, 0.03)
    r, wave = rng.uniform(0.025, 0.04), rng.uniform(0.1, 0.2)
    angle = _on_circle(24 * lobes)
    outline = r * (1.0 + wave * np.cos(lobes * angle))[:, None]
    outline = outline * np.column_stack([np.cos(angle), np.sin(angle)])
    shifted = np.roll(outline, -12, axis=0)  # slices reach from valley to valley
    slices = [
        np.concatenate([[(0.0, 0.0)], np.roll(shifted, -24 * k, axis=0)[4 * j : 4 * j + 5]])
        for k in range(lobes)
        for j in range(6)
    ]
    top = prism(outline, h, slices)
    ring = 0.4 * r * np.column_stack([np.cos(_on_circle(60)), np.sin(_on_circle(60))])
    stem = prism(ring, 0.03).moved(translation=(0, 0, -h / 2 - 0.013))
    return Shape(top | stem, polygon_symmetries(lobes))


def twisted_bar(rng: Rng) -> Shape:
    """Twisted candles and pillars: a regular outline that turns with height; no mirror plane."""
    sides, r = int(rng.integers(3, 6)), rng.uniform(0.016, 0.03)
    h, twist = rng.uniform(0.05, 0.12), np.radians(rng.uniform(50, 110))
    levels = np.linspace(-0.5, 0.5, 25)
    angle = _on_circle(sides)
    corner = r * np.column_stack([np.cos(angle), np.sin(angle)])
    edge = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None]
    outline = np.concatenate(
        [(1 - edge) * a + edge * b for a, b in zip(corner, np.roll(corner, -1, 0), strict=True)]
    )
    rings = []
    for level in levels:
        flat = outline @ rotation_about([0, 0, 1], level * twist)[:2, :2].T
        rings.append(np.column_stack([flat, np.full(len(flat), level * h)]))
    axis = (RotationSymmetry(np.array([0.0, 0.0, 1.0]), ORIGIN, sides),)
    return Shape(_loft(np.stack(rings), 12), axis)


def cookie_cutter(rng: Rng) -> Shape:
    """Cookie cutters and napkin rings: a thin wall along a wavy outline, open above and below."""
    lobes, h, wall = int(rng.integers(3, 7)), rng.uniform(0.014, 0.03), rng.uniform(0.0025, 0.004)
    r, wave = rng.uniform(0.03, 0.042), rng.uniform(0.08, 0.16)
    angle = _on_circle(16 * lobes)
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    outer = (r * (1.0 + wave * np.cos(lobes * angle)))[:, None] * ray
    inner = outer - wall * ray
    section = CrossSection([outer]) - CrossSection([inner])
    body = Manifold.extrude(section, h).translate((0, 0, -h / 2))
    fours = [np.concatenate([outer[[k, k - 1]], inner[[k, k - 1]]]) for k in range(len(angle))]
    pieces = tuple(on_levels(four, -h / 2, h / 2) for four in fours)
    return Shape(Solid(body, pieces), polygon_symmetries(lobes, level=True))


def horseshoe(rng: Rng) -> Shape:
    """Horseshoes and magnets: a bar bent to a U."""
    r, thick = rng.uniform(0.022, 0.036), rng.uniform(0.006, 0.01)
    reach = rng.uniform(0.75, 0.95) * np.pi
    angle = np.linspace(-reach, reach, 40)
    path = r * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
    radii = np.column_stack([np.full(40, thick), np.full(40, thick * rng.uniform(0.6, 1.3))])
    return Shape(bent_tube(path, radii, sides=20), mirror_axes("yz"))


def chair(rng: Rng) -> Shape:
    """Dolls' chairs: a seat, a back, four legs."""
    wide, deep, leg = rng.uniform(0.03, 0.04), rng.uniform(0.034, 0.045), rng.uniform(0.03, 0.045)
    thick, back = rng.uniform(0.005, 0.008), rng.uniform(0.035, 0.055)
    solid = box((2 * deep, 2 * wide, thick))
    rest = box((thick, 2 * wide, back)).moved(translation=(-deep + thick / 2, 0, back / 2))
    solid = solid | rest
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            post = box((thick, thick, leg))
            at = (x * (deep - thick / 2), y * (wide - thick / 2), -0.5 * leg)
            solid = solid | post.moved(translation=at)
    return Shape(solid, mirror_axes("y"))


def stairs(rng: Rng) -> Shape:
    """Steps and brackets: a prism of a staircase."""
    steps, wide = int(rng.integers(3, 5)), rng.uniform(0.03, 0.055)
    run, rise = rng.uniform(0.016, 0.028), rng.uniform(0.012, 0.02)
    outline = [(0.0, 0.0), (steps * run, 0.0)]
    for k in range(steps, 0, -1):
        outline += [(k * run, (steps - k + 1) * rise), ((k - 1) * run, (steps - k + 1) * rise)]
    blocks = [
        [
            (0, k * rise),
            ((steps - k) * run, k * rise),
            ((steps - k) * run, (k + 1) * rise),
            (0, (k + 1) * rise),
        ]
        for k in range(steps)
    ]
    return Shape(prism(outline, wide, blocks), mirror_axes("z"))


def tripod(rng: Rng) -> Shape:
    """Tripods and jacks: legs that spread from a hub."""
    legs, r = int(rng.choice([3, 4, 5])), rng.uniform(0.0055, 0.009)
    length, tilt = rng.uniform(0.05, 0.075), rng.uniform(0.5, 1.1)
    solid = ball(rng.uniform(0.014, 0.02), 60)
    path = np.linspace(0.0, 1.0, 8)[:, None] * length * [np.sin(tilt), 0.0, -np.cos(tilt)]
    limb = bent_tube(path, np.linspace(1.2 * r, r, 8), sides=20, up=(0, 1, 0))
    for k in range(legs):
        solid = solid | limb.moved(rotation_about([0, 0, 1], 2 * np.pi * k / legs))
    return Shape(solid, polygon_symmetries(legs))


def peanut(rng: Rng) -> Shape:
    """Peanuts, bones, hourglasses: Cassini's oval about its long axis."""
    a, b = rng.uniform(0.026, 0.036), rng.uniform(1.03, 1.25)
    angle = np.linspace(0.0, np.pi, 49)
    cosine = np.cos(2 * angle)
    radius = a * np.sqrt(cosine + np.sqrt(b**4 - np.sin(2 * angle) ** 2))
    z, r = radius * np.cos(angle), radius * np.sin(angle) * rng.uniform(0.9, 1.2)
    ray = np.column_stack([np.cos(_on_circle(64)), np.sin(_on_circle(64))])
    rings = [
        np.column_stack([max(ri, 5e-4) * ray, np.full(64, zi)])
        for ri, zi in zip(r[::-1], z[::-1], strict=True)
    ]
    return Shape(_loft(np.stack(rings), 12), revolution(level=True))


def slipper(rng: Rng) -> Shape:
    """Shoes and shells: ovals that grow, shift and tilt along a curve, without symmetry."""
    length, turn = rng.uniform(0.09, 0.15), _on_circle(40)
    t = np.linspace(0.0, 1.0, 21)
    wide = rng.uniform(0.02, 0.03) * (0.55 + 0.45 * np.sin(np.pi * t * 0.9 + 0.3))
    high = rng.uniform(0.014, 0.024) * (1.0 - 0.55 * t)
    side = rng.uniform(0.015, 0.025) * np.sin(1.7 * np.pi * t)
    rings = [
        np.column_stack(
            [
                np.full(40, length * ti),
                si + wi * np.cos(turn),
                hi * np.maximum(np.sin(turn), -0.55) + 0.004 * ti,
            ]
        )
        for ti, wi, hi, si in zip(t, wide, high, side, strict=True)
    ]
    return Shape(_loft(np.stack(rings), 10))


def fish(rng: Rng) -> Shape:
    """Fish and fans: a flat lens with a tail, cut from a board."""
    length, high, thick = (
        rng.uniform(0.07, 0.11),
        rng.uniform(0.02, 0.03),
        rng.uniform(0.012, 0.024),
    )
    t = np.linspace(0.0, 1.0, 25)
    body = high * np.sin(np.pi * t) ** 0.8
    upper = np.column_stack([length * t, body])[1:-1]
    lens = np.concatenate([[(0.0, 0.0)], (upper * [1, -1]), [(length, 0.0)], upper[::-1]])
    tail = np.array(
        [(0.75 * length, 0.0), (1.3 * length, -high), (1.2 * length, 0.0), (1.3 * length, high)]
    )
    fins = [tail[[0, 1, 2]], tail[[0, 2, 3]]]
    return Shape(prism(lens, thick) | prism(tail, thick, fins), mirror_axes("yz"))


def carved(rng: Rng) -> Shape:
    """Decoys of balls and eggs: an ellipsoid with one flat cut and a fin across the cut."""
    half = rng.uniform([0.026, 0.026, 0.026], [0.04, 0.036, 0.034])
    points = np.asarray(Manifold.sphere(1.0, 72).to_mesh64().vert_properties)[:, :3] * half
    points = points[points[:, 2] > -rng.uniform(0.3, 0.6) * half[2]]
    fin = box((0.9 * half[0], 0.006, 0.02)).moved(
        rotation_about([0, 0, 1], rng.uniform(0.4, 1.1)), (0.5 * half[0], 0.0, half[2])
    )
    return Shape(hull(points) | fin)
