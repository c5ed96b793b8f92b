"""Families of objects with flat faces: boxes, prisms, brackets, stars."""

import numpy as np

from pipelines.array_types import Array
from pipelines.synthesis.objects.shape import (
    Rng,
    Shape,
    mirror_axes,
    mirror_planes,
    polygon_symmetries,
)
from pipelines.synthesis.objects.solids import bent_tube, box, hull, prism, rounded_box


def carton(rng: Rng) -> Shape:
    """Cartons: boxes with three different edges."""
    size = np.sort(rng.uniform([0.02, 0.04, 0.06], [0.065, 0.1, 0.19]))
    size += [0.0, 0.006, 0.012]  # avoids squares, which have more symmetries
    return Shape(box(size[rng.permutation(3)], rng.uniform(0.0005, 0.002)), mirror_axes("xyz"))


def book(rng: Rng) -> Shape:
    """Books, boards, phones: flat boxes."""
    size = (rng.uniform(0.07, 0.12), rng.uniform(0.13, 0.2), rng.uniform(0.012, 0.035))
    return Shape(box(size, 0.001), mirror_axes("xyz"))


def soap(rng: Rng) -> Shape:
    """Soaps, remote controls, power banks: boxes with round edges."""
    size = np.array([rng.uniform(0.03, 0.055), rng.uniform(0.06, 0.14), rng.uniform(0.016, 0.028)])
    return Shape(rounded_box(size, size[2] * rng.uniform(0.2, 0.45)), mirror_axes("xyz"))


def cube(rng: Rng) -> Shape:
    """Dice and building blocks, with equal edges."""
    edge = rng.uniform(0.025, 0.065)
    diagonals = [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
    planes = mirror_axes("xyz") + mirror_planes(*(np.array(d) / np.sqrt(2.0) for d in diagonals))
    return Shape(rounded_box((edge, edge, edge), edge * rng.uniform(0.06, 0.15)), planes)


def regular_polygon(sides: int, radius: float) -> Array:
    """Return (sides, 2) corners, the first at +x."""
    angle = np.arange(sides) * 2.0 * np.pi / sides
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def polygon_prism(rng: Rng) -> Shape:
    """Prisms over a regular polygon: packs, nuts, pencils."""
    sides = int(rng.choice([3, 5, 6, 8]))
    r, h = rng.uniform(0.018, 0.045), rng.uniform(0.025, 0.16)
    return Shape(prism(regular_polygon(sides, r), h), polygon_symmetries(sides, level=True))


def star(rng: Rng) -> Shape:
    """Stars: cookie cutters, handwheels."""
    points, r, h = int(rng.integers(4, 8)), rng.uniform(0.03, 0.05), rng.uniform(0.015, 0.045)
    outer = regular_polygon(points, r)
    turn = np.pi / points
    c, s = np.cos(turn), np.sin(turn)
    inner = regular_polygon(points, r * rng.uniform(0.45, 0.7)) @ np.array([[c, s], [-s, c]])
    outline = np.stack([outer, inner], 1).reshape(-1, 2)
    arms = [np.array([(0, 0), inner[i - 1], outer[i], inner[i]]) for i in range(points)]
    return Shape(prism(outline, h, arms), polygon_symmetries(points, level=True))


def bracket(rng: Rng) -> Shape:
    """Angle brackets: two arms of different length."""
    a, b, t = rng.uniform(0.07, 0.12), rng.uniform(0.035, 0.06), rng.uniform(0.012, 0.025)
    depth = rng.uniform(0.02, 0.045)
    long = box((a, t, depth), 0.001).moved(translation=(a / 2 - t / 2, 0, 0))
    short = box((t, b, depth), 0.001).moved(translation=(0, b / 2 - t / 2, 0))
    return Shape(long | short, mirror_axes("z"))


def cross_connector(rng: Rng) -> Shape:
    """T- and plus-shaped connectors."""
    a, b, t = rng.uniform(0.07, 0.12), rng.uniform(0.03, 0.06), rng.uniform(0.016, 0.03)
    bar = box((a, t, t), 0.001)
    if rng.uniform() < 0.5:
        return Shape(bar | box((t, b + t, t), 0.001), mirror_axes("xyz"))
    stem = box((t, b + t / 2, t), 0.001).moved(translation=(0, b / 2 + t / 4, 0))
    return Shape(bar | stem, mirror_axes("xz"))


def elbow(rng: Rng) -> Shape:
    """Elbow pipes: a round bar bent by a right angle."""
    r, bend, leg = rng.uniform(0.01, 0.02), rng.uniform(0.03, 0.045), rng.uniform(0.02, 0.05)
    angle = np.linspace(0.0, np.pi / 2, 15)
    arc = bend * np.column_stack([np.sin(angle), 1 - np.cos(angle), np.zeros(15)])
    start = np.column_stack([np.linspace(-leg, 0, 5)[:-1], np.zeros(4), np.zeros(4)])
    end = np.column_stack([np.full(4, bend), bend + np.linspace(0, leg, 5)[1:], np.zeros(4)])
    path = np.concatenate([start, arc, end]) - [bend, 0.0, 0.0]
    planes = mirror_axes("z") + mirror_planes(np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
    return Shape(bent_tube(path, np.full(len(path), r)), planes)


def wedge(rng: Rng) -> Shape:
    """Door stops, cheese: a right triangle extruded."""
    a, b, depth = rng.uniform(0.06, 0.11), rng.uniform(0.025, 0.045), rng.uniform(0.025, 0.05)
    return Shape(prism([(0, 0), (a, 0), (0, b)], depth), mirror_axes("z"))


def stone(rng: Rng) -> Shape:
    """Stones: the hull of a few random points, without symmetry."""
    size = rng.uniform([0.022, 0.016, 0.013], [0.045, 0.03, 0.024])
    points = rng.normal(size=(int(rng.integers(10, 18)), 3))
    return Shape(hull(size * points / np.linalg.norm(points, axis=1, keepdims=True)))
