"""Further families of training: random turned and faceted bodies, handles, tools, thin walls.

Some are decoys: nearly as symmetric as another family, except for one cut or knob.
"""

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.transforms import rotation_about
from pipelines.synthesis.objects.families.compound import Z_TO_X, Z_TO_Y, cylinder, handle
from pipelines.synthesis.objects.families.lathed import rounded_lathe, smooth, vessel
from pipelines.synthesis.objects.families.prismatic import regular_polygon
from pipelines.synthesis.objects.revolved import lathe, pipe
from pipelines.synthesis.objects.shape import (
    Rng,
    Shape,
    mirror_axes,
    polygon_symmetries,
    revolution,
)
from pipelines.synthesis.objects.solids import (
    Solid,
    bent_tube,
    box,
    hull,
    on_levels,
    prism,
    rounded_box,
)


def _profile(rng: Rng, radius: float, height: float, knots: int) -> Array:
    """Return a smooth random profile of a turned body from z = 0 to `height`."""
    z = np.linspace(0.0, 1.0, knots) + np.pad(rng.uniform(-0.3, 0.3, knots - 2), 1) / knots
    radii = radius * rng.uniform(0.35, 1.0, knots)
    return smooth(z * height, radii, 28)


def turned(rng: Rng) -> Shape:
    """Knobs, handles, vases: a random profile on a lathe."""
    radius, height = rng.uniform(0.016, 0.042), rng.uniform(0.04, 0.16)
    return Shape(
        lathe(_profile(rng, radius, height, int(rng.integers(4, 8))), slabs=8), revolution()
    )


def spindle(rng: Rng) -> Shape:
    """Rolling pins, spools, table legs: a random profile and its mirror image."""
    return Shape(_spindle(rng, 72), revolution(level=True))


def _spindle(rng: Rng, segments: int) -> Solid:
    radius, half = rng.uniform(0.014, 0.04), rng.uniform(0.025, 0.08)
    upper = _profile(rng, radius, half, int(rng.integers(3, 6)))[
        1:
    ]  # without the point on the axis
    whole = np.concatenate([(upper * [1.0, -1.0])[::-1], upper[1:]])
    return lathe(whole, segments, slabs=10)


def crossed(rng: Rng) -> Shape:
    """Valves and hand wheels: two spindles across each other."""
    first, second = _spindle(rng, 36), _spindle(rng, 36)
    return Shape(first | second.moved(Z_TO_X), mirror_axes("xyz"))


def faceted(rng: Rng) -> Shape:
    """Crystals, nuts, pyramids: hull of random points, repeated about each of n corners."""
    order = int(rng.integers(3, 7))
    size = np.array([0.04, 0.04, 0.035]) * rng.uniform(0.6, 1.1)
    points = rng.normal(size=(int(rng.integers(2, 5)), 3))
    points = size * points / np.linalg.norm(points, axis=1, keepdims=True)
    points = np.concatenate([points, points * [1.0, -1.0, 1.0]])
    turns = [rotation_about([0, 0, 1], 2 * np.pi * k / order) for k in range(order)]
    orbit = np.concatenate([points @ turn.T for turn in turns])
    # A lid and a floor of different size: no mirror plane across the axis.
    ends = [
        np.column_stack([regular_polygon(order, share * size[0]), np.full(order, z * size[2])])
        for share, z in ((rng.uniform(0.2, 0.5), 1.1), (rng.uniform(0.6, 0.9), -0.9))
    ]
    return Shape(hull(np.concatenate([orbit, *ends])), polygon_symmetries(order))


def boulder(rng: Rng) -> Shape:
    """Cut stones, shoes, bags: hull of random points and of their mirror images."""
    axes = ("y", "xy", "xyz")[int(rng.integers(3))]
    size = rng.uniform([0.04, 0.026, 0.018], [0.075, 0.04, 0.03])
    points = rng.normal(size=(int(rng.integers(7, 14)), 3))
    points = size * points / np.linalg.norm(points, axis=1, keepdims=True)
    for name in axes:
        signs = 1.0 - 2.0 * np.eye(3)["xyz".index(name)]
        points = np.concatenate([points, points * signs])
    return Shape(hull(points), mirror_axes(axes))


def heap(rng: Rng) -> Shape:
    """Toys and parts: random convex and turned pieces grown together, without symmetry."""
    solid = hull(0.022 * rng.normal(size=(12, 3)) / 1.3)
    for _ in range(int(rng.integers(2, 4))):
        turn = rotation_about(rng.normal(size=3), rng.uniform(0.4, 2.6))
        piece = (
            _turned_piece(rng) if rng.uniform() < 0.5 else hull(0.014 * rng.normal(size=(10, 3)))
        )
        solid = solid | piece.moved(turn, rng.uniform(-0.02, 0.02, 3))
    return Shape(solid)


def _turned_piece(rng: Rng) -> Solid:
    """Return a small turned body about the origin."""
    solid = lathe(_profile(rng, 0.014, rng.uniform(0.03, 0.06), 4), 28, slabs=4)
    return Shape(solid).centered().solid


def pan(rng: Rng) -> Shape:
    """Pans and sauce pots: a thin-walled vessel with one long handle."""
    r, h = rng.uniform(0.045, 0.07), rng.uniform(0.025, 0.06)
    length, thick = rng.uniform(0.07, 0.11), rng.uniform(0.004, 0.007)
    t = np.linspace(0.0, 1.0, 14)
    path = np.column_stack([r - 0.001 + length * t, np.zeros(14), 0.85 * h + 0.012 * t**2])
    bar = bent_tube(path, np.tile([1.6 * thick, thick], (14, 1)), sides=16)
    wall = rng.uniform(0.002, 0.004)
    return Shape(vessel(r, h, rng.uniform(0.8, 0.95), wall) | bar, mirror_axes("y"))


def pot(rng: Rng) -> Shape:
    """Casseroles and trophies: a vessel with two handles."""
    r, h = rng.uniform(0.035, 0.05), rng.uniform(0.04, 0.08)
    wall, thick = rng.uniform(0.0025, 0.004), rng.uniform(0.004, 0.006)
    bow = handle(r - 0.5 * wall, 0.45 * h, 0.85 * h, rng.uniform(0.014, 0.022), thick)
    return Shape(vessel(r, h, 1.0, wall) | bow | bow.moved(np.diag([-1, 1, 1])), mirror_axes("xy"))


def bucket(rng: Rng) -> Shape:
    """Buckets and baskets: a bail from rim to rim over the opening."""
    r, h, thick = rng.uniform(0.032, 0.043), rng.uniform(0.05, 0.075), rng.uniform(0.003, 0.005)
    wall = rng.uniform(0.0025, 0.004)
    angle = np.linspace(0.0, np.pi, 26)
    rim = r - 0.5 * wall
    path = np.column_stack(
        [rim * np.cos(angle), np.zeros(26), 0.93 * h + rng.uniform(0.9, 1.3) * r * np.sin(angle)]
    )
    bail = bent_tube(path, np.full((26, 2), thick), sides=16, up=(0, 1, 0))
    return Shape(vessel(r, h, rng.uniform(0.7, 0.95), wall) | bail, mirror_axes("xy"))


def case(rng: Rng) -> Shape:
    """Open boxes, drawers, punnets: four thin walls and a floor."""
    x, y = np.sort(rng.uniform([0.03, 0.05], [0.045, 0.085]))
    h, wall = rng.uniform(0.025, 0.06), rng.uniform(0.002, 0.004)
    y += 0.008  # no square
    floor = box((2 * x, 2 * y, 2 * wall)).moved(translation=(0, 0, wall))
    solid = floor
    for sign in (-1.0, 1.0):
        long = box((wall, 2 * y, h)).moved(translation=(sign * (x - wall / 2), 0, h / 2))
        short = box((2 * x, wall, h)).moved(translation=(0, sign * (y - wall / 2), h / 2))
        solid = solid | long | short
    return Shape(solid, mirror_axes("xy"))


def spanner(rng: Rng) -> Shape:
    """Spanners: a flat bar with a jaw that is open at one end."""
    length, thick = rng.uniform(0.09, 0.14), rng.uniform(0.006, 0.012)
    wide, jaw = rng.uniform(0.011, 0.018), rng.uniform(0.011, 0.016)
    bar = box((length, wide, thick), 0.001)
    cheek = [
        (0.0, 0.4 * jaw),
        (0.5 * jaw, 1.5 * jaw),
        (2.1 * jaw, 1.2 * jaw),
        (2.3 * jaw, 0.65 * jaw),
    ]
    cheek += [(0.8 * jaw, 0.6 * jaw)]
    upper = prism(cheek[::-1], 1.2 * thick).moved(translation=(length / 2 - 0.5 * jaw, 0, 0))
    root = box((1.4 * jaw, 2.0 * jaw, 1.2 * thick)).moved(translation=(length / 2, 0, 0))
    lower = upper.moved(np.diag([1, -1, 1]))
    return Shape(bar | root | upper | lower, mirror_axes("yz"))


def pliers(rng: Rng) -> Shape:
    """Pliers and tongs: two arms that cross at a bolt."""
    length, thick = rng.uniform(0.09, 0.14), rng.uniform(0.008, 0.012)
    wide, angle = rng.uniform(0.009, 0.013), rng.uniform(0.12, 0.25)
    arm = box((length, wide, thick), 0.001).moved(translation=(-0.5 * length, 0, 0))
    jaw = prism(
        [(0, -wide / 2), (0.35 * length, -0.2 * wide), (0.35 * length, 0.2 * wide), (0, wide / 2)],
        thick,
    )
    solid = cylinder(0.9 * wide, 1.4 * thick)
    for sign in (-1.0, 1.0):
        turn = rotation_about([0, 0, 1], sign * angle)
        back = rotation_about([0, 0, 1], -0.5 * sign * angle)
        solid = solid | arm.moved(turn) | jaw.moved(back)
    return Shape(solid, mirror_axes("yz"))


def brush(rng: Rng) -> Shape:
    """Brushes and scrubbers: a slim handle, bristles below one end."""
    length, wide = rng.uniform(0.12, 0.18), rng.uniform(0.014, 0.026)
    thick, bristles = rng.uniform(0.008, 0.012), rng.uniform(0.014, 0.03)
    grip = rounded_box((length, wide, thick), 0.35 * thick)
    head = length * rng.uniform(0.25, 0.45)
    tuft = box((head, 0.8 * wide, bristles)).moved(
        translation=(0.5 * length - 0.5 * head - 0.004, 0, -0.5 * (thick + bristles) + 0.001)
    )
    return Shape(grip | tuft, mirror_axes("y"))


def torch(rng: Rng) -> Shape:
    """Torches and microphones: a wide head on a slim handle."""
    r, length = rng.uniform(0.01, 0.016), rng.uniform(0.08, 0.13)
    head, lip = r * rng.uniform(1.4, 2.1), rng.uniform(0.012, 0.025)
    corners = [(0, 0), (0.9 * r, 0), (r, 0.01), (r, length), (head, length + 0.02)]
    corners += [(head, length + 0.02 + lip), (0, length + 0.02 + lip)]
    return Shape(rounded_lathe(corners, 0.002, slabs=6), revolution())


def drill(rng: Rng) -> Shape:
    """Drills and hair dryers: a round body across a grip, a bit in front."""
    r, length, grip = rng.uniform(0.018, 0.026), rng.uniform(0.08, 0.11), rng.uniform(0.06, 0.085)
    body = cylinder(r, length).moved(Z_TO_X)
    lean = rotation_about([0.0, 1.0, 0.0], rng.uniform(0.05, 0.3))
    shaft = rounded_box((0.03, 0.024, grip), 0.006).moved(
        lean, (-0.25 * length, 0, -0.5 * grip - 0.4 * r)
    )
    bit = cylinder(0.35 * r, 0.05).moved(Z_TO_X, (0.5 * length + 0.02, 0, 0))
    return Shape(body | shaft | bit, mirror_axes("y"))


def nut(rng: Rng) -> Shape:
    """Nuts and washers: a regular prism about a round hole."""
    sides = int(rng.choice([4, 6, 8]))
    r, h = rng.uniform(0.024, 0.045), rng.uniform(0.012, 0.035)
    hole = r * np.cos(np.pi / sides) * rng.uniform(0.45, 0.7)
    corners = regular_polygon(sides, r)
    drilled = prism(corners, h).body - cylinder(hole, 2.0 * h).body
    angle = 2 * np.pi / sides
    pieces = []
    for k in range(sides):
        arc = k * angle + np.linspace(0.0, angle, 4)
        inside = hole * np.column_stack([np.cos(arc), np.sin(arc)])
        flat = np.concatenate([corners[[k, (k + 1) % sides]], inside])
        pieces.append(on_levels(flat, -h / 2, h / 2))
    return Shape(Solid(drilled, tuple(pieces)), polygon_symmetries(sides, level=True))


def hook(rng: Rng) -> Shape:
    """Hooks and canes: a bar that bends back."""
    r, bend, leg = rng.uniform(0.005, 0.009), rng.uniform(0.018, 0.03), rng.uniform(0.06, 0.11)
    angle = np.linspace(0.0, np.pi * rng.uniform(0.8, 1.1), 24)
    arc = np.column_stack([bend - bend * np.cos(angle), np.zeros(24), leg + bend * np.sin(angle)])
    start = np.column_stack([np.zeros(6), np.zeros(6), np.linspace(0, leg, 7)[:-1]])
    path = np.concatenate([start, arc])
    return Shape(bent_tube(path, np.full(len(path), r), up=(0, 1, 0)), mirror_axes("y"))


def decoy_carton(rng: Rng) -> Shape:
    """Decoys of cartons: a box with a second, smaller box off the middle of its lid."""
    size = np.sort(rng.uniform([0.03, 0.056, 0.092], [0.045, 0.076, 0.14]))[::-1]
    lid = size * rng.uniform(0.3, 0.45, 3)
    place = [0.22 * size[0], 0.22 * size[1], 0.5 * (size[2] + lid[2]) - 0.001]
    return Shape(box(size, 0.001) | box(lid).moved(translation=place))


def decoy_can(rng: Rng) -> Shape:
    """Decoys of cans: a cylinder with a flat cut along one side."""
    r, h = rng.uniform(0.022, 0.038), rng.uniform(0.05, 0.11)
    angle = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
    outline = r * np.column_stack([np.cos(angle), np.sin(angle)])
    outline[:, 0] = np.minimum(outline[:, 0], rng.uniform(0.45, 0.65) * r)
    keep = np.r_[True, np.linalg.norm(np.diff(outline, axis=0), axis=1) > 1e-9]
    return Shape(prism(outline[keep], h), mirror_axes("yz"))


def decoy_bottle(rng: Rng) -> Shape:
    """Decoys of bottles: the neck is off the axis."""
    r, h = rng.uniform(0.026, 0.04), rng.uniform(0.07, 0.12)
    neck, long = r * rng.uniform(0.3, 0.42), rng.uniform(0.025, 0.045)
    body = rounded_lathe([(0, 0), (r, 0), (r, h), (0, h)], 0.006)
    spout = cylinder(neck, long).moved(
        translation=((r - neck) * rng.uniform(0.6, 0.9), 0, h + 0.5 * long - 0.003)
    )
    return Shape(body | spout, mirror_axes("y"))


def tape_dispenser(rng: Rng) -> Shape:
    """Rolls in a holder: a thick pipe on a foot."""
    r, w = rng.uniform(0.024, 0.034), rng.uniform(0.018, 0.03)
    roll = pipe(r, r * rng.uniform(0.5, 0.7), w, 0.0015).moved(Z_TO_Y)
    foot = box((2.6 * r, 1.3 * w, 0.016), 0.001).moved(
        translation=(rng.uniform(0.15, 0.3) * r, 0, -r)
    )
    return Shape(roll | foot, mirror_axes("y"))
