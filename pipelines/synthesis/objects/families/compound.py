"""Families of objects of several parts: tools, toys, vessels with a handle, bent and lumpy objects.

Almost all have one mirror plane, y = 0, or none.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipelines.geometry.transforms import rotation_about
from pipelines.synthesis.objects.families.lathed import rounded_lathe, smooth, vessel
from pipelines.synthesis.objects.revolved import lathe
from pipelines.synthesis.objects.shape import Rng, Shape, mirror_axes
from pipelines.synthesis.objects.solids import Solid, ball, bent_tube, box, lump, prism, rounded_box

Z_TO_X = rotation_about([0.0, 1.0, 0.0], np.pi / 2)  # z axis to +x, x axis to -z
Z_TO_Y = rotation_about([1.0, 0.0, 0.0], -np.pi / 2)  # z axis to +y


def cylinder(radius: float, height: float) -> Solid:
    """Return a cylinder about the z axis with slightly rounded edges, its centre at the origin."""
    h = height / 2
    corners = [(0, -h), (radius, -h), (radius, h), (0, h)]
    return rounded_lathe(corners, min(0.0015, 0.2 * radius), segments=36)


def ellipsoid(radii: ArrayLike) -> Solid:
    """Return an ellipsoid about the origin."""
    return ball(1.0, 48).moved(np.diag(np.asarray(radii, float)))


def handle(rim: float, low: float, high: float, reach: float, thick: float) -> Solid:
    """Return a handle in the xz plane, from the wall at x = `rim` out by `reach` and back."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 22)
    x = rim + reach * np.cos(angle)
    z = (low + high) / 2 + (high - low) / 2 * np.sin(angle)
    path = np.column_stack([x, np.zeros(22), z])
    return bent_tube(path, np.tile([thick, 1.3 * thick], (22, 1)), sides=20, up=(0, 1, 0))


def mug(rng: Rng) -> Shape:
    """Mugs: a cup with a handle."""
    r, h, wall = rng.uniform(0.033, 0.043), rng.uniform(0.07, 0.105), rng.uniform(0.003, 0.005)
    taper, thick = rng.uniform(0.85, 1.0), rng.uniform(0.004, 0.006)
    # The ends of the handle stay inside the wall.
    rim = r * (taper + (1 - taper) * 0.5) - 0.5 * wall
    bow = handle(rim, 0.2 * h, 0.8 * h, rng.uniform(0.022, 0.032), thick)
    cavity = vessel_cavity(r, h, taper, wall)
    return Shape((vessel(r, h, taper, wall) | bow) - cavity, mirror_axes("y"))


def vessel_cavity(radius: float, height: float, taper: float, wall: float) -> Solid:
    """Return the cavity of `vessel`, to cut away parts that reach into it."""
    floor, slope = 1.5 * wall, radius * (1 - taper) / height
    foot, top = radius * taper + slope * floor - wall, radius - wall
    rim, end = top + slope * 0.01, height + 0.01
    return lathe([(0, floor), (foot - 0.005, floor), (foot, floor + 0.005), (rim, end), (0, end)])


def pitcher(rng: Rng) -> Shape:
    """Jugs: a belly with a handle on one side and a spout on the other."""
    r, h = rng.uniform(0.03, 0.042), rng.uniform(0.1, 0.16)
    neck = r * rng.uniform(0.5, 0.75)
    z = np.array([0, 0.1, 0.4, 0.8, 1]) * h
    belly = lathe(smooth(z, [0.8 * r, 0.95 * r, r, neck, 1.1 * neck]))
    bow = handle(0.55 * r, 0.25 * h, 0.85 * h, rng.uniform(0.035, 0.045), 0.005)
    beak = ellipsoid((0.022, 0.009, 0.012)).moved(translation=(-1.1 * neck, 0, 0.95 * h))
    return Shape(belly | bow | beak, mirror_axes("y"))


def hammer(rng: Rng) -> Shape:
    """Hammers: a round or square face on one side, a wedge on the other."""
    length, r = rng.uniform(0.14, 0.22), rng.uniform(0.009, 0.014)
    head, thick = rng.uniform(0.03, 0.045), rng.uniform(0.011, 0.016)
    z = np.array([0, 0.03, 0.25, 0.5, 1]) * length
    grip = lathe(smooth(z, [0.8 * r, r, 1.15 * r, 0.85 * r, 0.75 * r]), slabs=3)
    face = cylinder(thick, head).moved(Z_TO_X, (head / 2, 0, length))
    peen = prism([(0, -thick), (0, thick), (-head, 0.4 * thick)], 1.6 * thick)
    peen = peen.moved(rotation_about([1.0, 0.0, 0.0], np.pi / 2), (0.0, 0, length))
    eye = box((0.02, 1.7 * thick, 2 * thick)).moved(translation=(0, 0, length))
    return Shape(grip | face | peen | eye, mirror_axes("y"))


def mallet(rng: Rng) -> Shape:
    """Mallets: both faces of the head are equal."""
    length, r, head = rng.uniform(0.13, 0.2), rng.uniform(0.008, 0.013), rng.uniform(0.05, 0.09)
    grip = cylinder(r, length).moved(translation=(0, 0, length / 2))
    block = cylinder(rng.uniform(0.018, 0.028), head).moved(Z_TO_X, (0, 0, length))
    return Shape(grip | block, mirror_axes("xy"))


def screwdriver(rng: Rng) -> Shape:
    """Screwdrivers: a round grip, a shaft, a flat tip."""
    r, grip, shaft = rng.uniform(0.011, 0.018), rng.uniform(0.07, 0.1), rng.uniform(0.05, 0.1)
    thin = rng.uniform(0.003, 0.005)
    z = np.array([0, 0.05, 0.2, 0.6, 0.85, 1.0]) * grip
    handle = lathe(smooth(z, np.array([0.7, 0.95, 1, 0.92, 0.65, 0.8]) * r), slabs=3)
    rod = cylinder(thin, shaft + 0.01).moved(translation=(0, 0, grip + shaft / 2 - 0.005))
    tip = box((3.2 * thin, 0.0022, 0.012)).moved(translation=(0, 0, grip + shaft + 0.004))
    return Shape(handle | rod | tip, mirror_axes("xy"))


def knife(rng: Rng) -> Shape:
    """Table knives: a thick handle, a thin blade with one straight edge."""
    handle, blade = rng.uniform(0.08, 0.11), rng.uniform(0.08, 0.12)
    high, thick = rng.uniform(0.018, 0.026), rng.uniform(0.012, 0.018)
    grip = rounded_box((handle, thick, high), 0.4 * thick).moved(translation=(-handle / 2, 0, 0))
    edge, back = -high / 2, high / 2
    outline = [(-0.01, edge), (0.75 * blade, edge), (blade, 0.2 * high), (-0.01, back)]
    flat = prism(outline, 0.003).moved(rotation_about([1.0, 0.0, 0.0], np.pi / 2))
    return Shape(grip | flat, mirror_axes("y"))


def spoon(rng: Rng) -> Shape:
    """Ladles and spoons: an oval at the end of a flat bent bar."""
    length, wide = rng.uniform(0.12, 0.17), rng.uniform(0.02, 0.028)
    t = np.linspace(0.0, 1.0, 24)
    path = np.column_stack([length * t, np.zeros(24), 0.02 * t**2])
    bar = bent_tube(path, np.column_stack([np.full(24, 0.006), np.full(24, 0.003)]), sides=16)
    oval = ellipsoid((1.4 * wide, wide, 0.007)).moved(translation=(-1.1 * wide, 0, 0.001))
    return Shape(bar | oval, mirror_axes("y"))


def banana(rng: Rng) -> Shape:
    """Bananas and croissants: bent, thick in the middle, with a stem at one end."""
    r, bend = rng.uniform(0.014, 0.02), rng.uniform(0.06, 0.1)
    half = rng.uniform(0.6, 1.0)
    angle = np.linspace(-half, half, 32)
    path = bend * np.column_stack([np.sin(angle), np.zeros(32), 1 - np.cos(angle)])
    t = np.linspace(0.0, 1.0, 32)
    shape = np.interp(t, [0, 0.04, 0.2, 0.5, 0.8, 0.92, 1.0], [0.15, 0.5, 0.9, 1, 0.85, 0.4, 0.25])
    return Shape(bent_tube(path, r * shape, up=(0, 1, 0)), mirror_axes("y"))


def spray_bottle(rng: Rng) -> Shape:
    """Spray bottles: a body, a neck, a head with nozzle and trigger."""
    r, h = rng.uniform(0.026, 0.036), rng.uniform(0.11, 0.16)
    z = np.array([0, 0.05, 0.6, 0.85, 1.0]) * h
    body = lathe(smooth(z, np.array([0.92, 1, 0.95, 0.4, 0.38]) * r), slabs=5)
    head = rounded_box((0.06, 0.022, 0.026), 0.006).moved(translation=(0.012, 0, h + 0.01))
    nozzle = cylinder(0.006, 0.014).moved(Z_TO_X, (0.046, 0, h + 0.012))
    path = np.column_stack(
        [np.linspace(0.03, 0.042, 10), np.zeros(10), h - np.linspace(0, 0.04, 10)]
    )
    trigger = bent_tube(path, np.full((10, 2), (0.004, 0.006)), sides=12, up=(0, 1, 0))
    return Shape(body | head | nozzle | trigger, mirror_axes("y"))


def clamp(rng: Rng) -> Shape:
    """Screw clamps: a C-shaped frame with a spindle through one arm."""
    high, deep, t = rng.uniform(0.06, 0.09), rng.uniform(0.04, 0.06), rng.uniform(0.011, 0.015)
    back = box((t, t, high), 0.001)
    arm = box((deep, t, t), 0.001).moved(translation=(deep / 2 - t / 2, 0, 0))
    up, down = (arm.moved(translation=(0, 0, s * (high - t) / 2)) for s in (1, -1))
    spindle = cylinder(0.0045, 0.8 * high).moved(translation=(deep - 1.2 * t, 0, -0.45 * high))
    knob = cylinder(0.009, 0.012).moved(translation=(deep - 1.2 * t, 0, -0.85 * high))
    return Shape(back | up | down | spindle | knob, mirror_axes("y"))


def vehicle(rng: Rng) -> Shape:
    """Toy cars: hull, cabin, four wheels."""
    length, wide, r = rng.uniform(0.07, 0.12), rng.uniform(0.035, 0.05), rng.uniform(0.01, 0.015)
    body = rounded_box((length, wide, 0.024), 0.005).moved(translation=(0, 0, r + 0.008))
    cabin = rounded_box((0.5 * length, 0.85 * wide, 0.024), 0.006)
    solid = body | cabin.moved(translation=(rng.uniform(-0.12, -0.04) * length, 0, r + 0.028))
    wheel = cylinder(r, wide + 0.008).moved(Z_TO_Y)
    for x in (-0.3 * length, 0.3 * length):
        solid = solid | wheel.moved(translation=(x, 0, r))
    return Shape(solid, mirror_axes("y"))


def animal(rng: Rng) -> Shape:
    """Toy animals: trunk, head, snout, four legs, a tail."""
    length, r = rng.uniform(0.035, 0.05), rng.uniform(0.017, 0.024)
    leg, thick = rng.uniform(0.025, 0.04), rng.uniform(0.006, 0.009)
    solid = ellipsoid((length, r, 0.9 * r)).moved(translation=(0, 0, leg + 0.6 * r))
    head = np.array([0.85 * length, 0, leg + rng.uniform(1.0, 1.5) * r])
    solid = solid | ball(0.7 * r, 48).moved(translation=head)
    snout = ellipsoid((0.55 * r, 0.35 * r, 0.35 * r))
    solid = solid | snout.moved(translation=head + np.array([0.75, 0.0, -0.15]) * r)
    for x in (-0.6 * length, 0.6 * length):
        for y in (-0.55 * r, 0.55 * r):
            solid = solid | cylinder(thick, leg + r).moved(translation=(x, y, (leg + r) / 2))
    tail = ellipsoid((0.5 * length, 0.004, 0.004))
    tail = tail.moved(translation=(-1.2 * length, 0, leg + 0.8 * r))
    return Shape(solid | tail, mirror_axes("y"))


def figure(rng: Rng) -> Shape:
    """Toy figures: trunk, head, arms held out, legs; symmetric left and right."""
    high, wide = rng.uniform(0.035, 0.05), rng.uniform(0.024, 0.034)
    solid = rounded_box((0.5 * wide, wide, high), 0.006)
    solid = solid | ball(0.42 * wide, 48).moved(translation=(0, 0, high / 2 + 0.3 * wide))
    tilt = rng.uniform(0.3, 1.2)
    for side in (-1, 1):
        arm = cylinder(0.006, 0.04).moved(rotation_about([1.0, 0.0, 0.0], side * tilt))
        solid = solid | arm.moved(translation=(0, side * (wide / 2 + 0.008), 0.15 * high))
        leg = cylinder(0.0075, 0.045)
        solid = solid | leg.moved(translation=(0.002, side * 0.27 * wide, -high / 2 - 0.012))
    return Shape(solid, mirror_axes("y"))


def mouse(rng: Rng) -> Shape:
    """Computer mice, irons: half an egg with a flat sole."""
    size = rng.uniform(0.045, 0.06), rng.uniform(0.025, 0.034), rng.uniform(0.03, 0.04)
    egg = lump(1.0, size, [(np.array([1.6, 0.0, 0.0]), 0.08, 0.0)])
    sole = box((0.3, 0.3, 0.3)).moved(translation=(0, 0, -0.15))
    cut = Solid((egg.body - sole.body), (egg.pieces[0][egg.pieces[0][:, 2] >= 0],))
    return Shape(cut, mirror_axes("y"))


def plug(rng: Rng) -> Shape:
    """Plugs and adapters: a block with two pins and a cable boot."""
    r, h = rng.uniform(0.018, 0.024), rng.uniform(0.025, 0.04)
    solid = rounded_lathe([(0, 0), (r, 0), (0.8 * r, h), (0, h)], 0.004)
    for y in (-0.0095, 0.0095):
        solid = solid | cylinder(0.0024, 0.024).moved(translation=(0, y, -0.01))
    boot = cylinder(0.006, 0.03).moved(translation=(0, 0, h + 0.01))
    return Shape(solid | boot, mirror_axes("xy"))


def lumpy(rng: Rng) -> Shape:
    """Potatoes, clay, soft toys: round, without symmetry."""
    waves = [
        (rng.normal(size=3) * rng.uniform(1.5, 3.0), rng.uniform(0.04, 0.09), rng.uniform(0, 6.28))
        for _ in range(4)
    ]
    stretch = rng.uniform([0.9, 0.7, 0.6], [1.5, 1.0, 0.9])
    return Shape(lump(rng.uniform(0.025, 0.036), stretch, waves))


def sculpture(rng: Rng) -> Shape:
    """Blocks joined at odd angles, without symmetry."""
    solid = rounded_box(rng.uniform(0.025, 0.05, 3), 0.004)
    for _ in range(int(rng.integers(2, 4))):
        turn = rotation_about(rng.normal(size=3), rng.uniform(0.4, 1.4))
        part = rounded_box(rng.uniform(0.018, 0.045, 3), 0.004)
        solid = solid | part.moved(turn, rng.uniform(-0.02, 0.02, 3))
    return Shape(solid)
