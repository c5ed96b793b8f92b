"""Bins, trays, walls, table edges and robot bases around the objects of a scene; table frame, z up.

A bin or tray is placed before the objects are dropped into it; everything else is placed next to
objects at rest. All solids are convex obstacles for the grasps of a scene, but no objects.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, rotation_about
from pipelines.synthesis.objects.decomposition import hull_of_points
from pipelines.synthesis.objects.solids import on_levels

# Angles of elevation, radians, between which cameras look into a container.
INTO_BIN, INTO_TRAY = (np.radians(52.0), np.radians(85.0)), (np.radians(40.0), np.radians(80.0))
TOWARD_WALL, INTO_CORNER = np.radians(60.0), np.radians(35.0)  # half arcs of the cameras' azimuths
FAR = 1.5  # metres, half extents of walls and of the remaining table
WALL_THICKNESS = 0.05  # metres


@dataclass(frozen=True)
class SceneSurroundings:
    """Solids on or next to the table, and the directions from which cameras see the objects.

    Attributes:
        solids: convex meshes.
        table: mesh of a table that ends near the objects; None for the large table.
        arc: middle and half width of the azimuths of cameras, radians; None for all around.
        elevations: lowest and highest elevation of cameras, radians; None for the default.
    """

    solids: tuple[Mesh, ...] = ()
    table: Mesh | None = None
    arc: tuple[float, float] | None = None
    elevations: tuple[float, float] | None = None


@dataclass(frozen=True)
class Container:
    """An open box with a floor, its middle at the origin of the table.

    Attributes:
        half: (2,) half extents of the floor inside, metres.
        yaw: angle of its axes, radians.
        floor: height of the floor above the table, metres.
        solids: convex meshes: the plate of the floor first, then the walls.
        elevations: elevations of cameras that see the inside, radians.
    """

    half: Array
    yaw: float
    floor: float
    solids: tuple[Mesh, ...]
    elevations: tuple[float, float]

    def place(self, radius: float, rng: np.random.Generator) -> Array:
        """Return a random place (2,) for an object of `radius`, metres."""
        span = np.maximum(self.half - radius, 0.2 * self.half)
        return np.asarray(_turn(self.yaw)[:2, :2] @ rng.uniform(-span, span))

    def holds(self, points: Array) -> Mask:
        """Return a mask (n,) of `points` (n, 3) above the floor, between the walls."""
        across = points[:, :2] @ _turn(self.yaw)[:2, :2]
        inside = (np.abs(across) < self.half).all(axis=1)
        return np.asarray(inside & (points[:, 2] > self.floor - 0.02))


def drawn_container(kind: str, rng: np.random.Generator) -> Container | None:
    """Return a random container; None if `kind` is neither bin nor tray."""
    if kind == "bin":
        half = rng.uniform([0.13, 0.1], [0.24, 0.18])
        height, slope = rng.uniform(0.05, 0.16), np.tan(np.radians(rng.uniform(0.0, 12.0)))
        wall, floor, elevations = rng.uniform(0.003, 0.01), rng.uniform(0.002, 0.006), INTO_BIN
    elif kind == "tray":
        half = rng.uniform([0.15, 0.11], [0.27, 0.2])
        height, slope = rng.uniform(0.01, 0.035), rng.uniform(0.0, 1.0)
        wall, floor, elevations = rng.uniform(0.002, 0.012), rng.uniform(0.002, 0.006), INTO_TRAY
    else:
        return None
    spread = slope * height
    solids = [slab(half + wall, 0.0, floor)]
    solids += frame(half, half + wall, half + spread, half + spread + wall, 0.0, height)
    if rng.uniform() < 0.5:  # a rim for lifting
        inner, outer = half + spread, half + spread + wall + rng.uniform(0.008, 0.025)
        solids += frame(inner, outer, inner, outer, height - 0.003, height)
    if kind == "bin" and rng.uniform() < 0.25:  # a wall between two compartments
        middle, top = rng.uniform(-0.4, 0.4) * half[0], rng.uniform(0.4, 0.95) * height
        between = slab([0.5 * wall, half[1]], floor, top)
        solids.append(between.transformed(make_pose(np.eye(3), [middle, 0.0, 0.0])))
    yaw = float(rng.uniform(0.0, 2.0 * np.pi))
    turned = tuple(solid.transformed(_turn(yaw)) for solid in solids)
    return Container(half, yaw, float(floor), turned, elevations)


def drawn_surroundings(
    kind: str, container: Container | None, footprint: Array, rng: np.random.Generator
) -> SceneSurroundings:
    """Return random surroundings of objects at rest.

    `footprint`: (n, 2) metres, points of the table below points of the objects.
    """
    if container is not None:
        return SceneSurroundings(container.solids, elevations=container.elevations)
    match kind:
        case "wall":
            return _wall(footprint, rng)
        case "edge":
            return _edge(footprint, rng)
        case "base":
            return _base(footprint, rng)
        case _:
            return SceneSurroundings()


def slab(half: ArrayLike, low: float, high: float) -> Mesh:
    """Return the upright block about the z axis of `half` (2,) extents from `low` to `high`."""
    signs = np.array([[x, y] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    return _prism(signs * np.asarray(half, np.float64), low, high)


def frame(
    inner_low: Array,
    outer_low: Array,
    inner_high: Array,
    outer_high: Array,
    low: float,
    high: float,
) -> list[Mesh]:
    """Return the four walls between an inner and an outer pyramid stump, mitred at the corners.

    Each argument except the heights is half extents (2,) at the height of its name, metres.
    """
    walls = []
    for axis in (0, 1):
        for side in (-1.0, 1.0):
            corners = [
                _corner(half, axis, side, along, height)
                for inner, outer, height in (
                    (inner_low, outer_low, low),
                    (inner_high, outer_high, high),
                )
                for half in (inner, outer)
                for along in (-1.0, 1.0)
            ]
            walls.append(hull_of_points(np.array(corners)))
    return walls


def _corner(half: Array, axis: int, side: float, along: float, height: float) -> list[float]:
    place = [0.0, 0.0, height]
    place[axis], place[1 - axis] = side * half[axis], along * half[1 - axis]
    return place


def _wall(footprint: Array, rng: np.random.Generator) -> SceneSurroundings:
    """Return a wall, two walls in a corner, or a panel behind the objects."""
    azimuth = float(rng.uniform(0.0, 2.0 * np.pi))
    shape = rng.choice(["wall", "corner", "panel"], p=[0.5, 0.25, 0.25])
    if shape == "panel":  # a monitor, a carton, the side of a cupboard
        width, top = rng.uniform(0.12, 0.35), rng.uniform(0.12, 0.45)
        thickness = rng.uniform(0.015, 0.12)
        solids = (_upright(footprint, azimuth, width, top, thickness, rng),)
        return SceneSurroundings(solids, arc=(azimuth + np.pi, TOWARD_WALL))
    top = rng.uniform(0.25, 1.5)
    first = _upright(footprint, azimuth, FAR, top, WALL_THICKNESS, rng)
    if shape == "wall":
        return SceneSurroundings((first,), arc=(azimuth + np.pi, TOWARD_WALL))
    second = _upright(footprint, azimuth + np.pi / 2, FAR, top, WALL_THICKNESS, rng)
    return SceneSurroundings((first, second), arc=(azimuth + 1.25 * np.pi, INTO_CORNER))


def _upright(
    footprint: Array,
    azimuth: float,
    half_width: float,
    top: float,
    thickness: float,
    rng: np.random.Generator,
) -> Mesh:
    """Return a wall across `azimuth`, beyond all objects."""
    near = _reach(footprint, azimuth) + 0.004 + 0.25 * rng.uniform() ** 2
    block = slab([0.5 * thickness, half_width], -0.02, top)
    moved = make_pose(np.eye(3), [near + 0.5 * thickness, 0.0, 0.0])
    return block.transformed(_turn(azimuth) @ moved)


def _edge(footprint: Array, rng: np.random.Generator) -> SceneSurroundings:
    """Return a table that ends next to the objects, on one or two sides."""
    azimuth = float(rng.uniform(0.0, 2.0 * np.pi))
    ends = [_reach(footprint, azimuth + turn) + 0.12 * rng.uniform() for turn in (0.0, np.pi / 2)]
    if rng.uniform() < 0.6:
        ends[1] = FAR
    corners = np.array([[x, y] for x in (-FAR, ends[0]) for y in (-FAR, ends[1])])
    thickness = rng.uniform(0.015, 0.06)
    return SceneSurroundings(table=_prism(corners, 0.0, -thickness).transformed(_turn(azimuth)))


def _base(footprint: Array, rng: np.random.Generator) -> SceneSurroundings:
    """Return the round or square base of a robot with its first joint."""
    azimuth = float(rng.uniform(0.0, 2.0 * np.pi))
    sides = int(rng.choice([4, 6, 24]))
    radii = rng.uniform(0.06, 0.11) * np.array([1.0, rng.uniform(0.6, 1.0)])
    height = rng.uniform(0.04, 0.12)
    place = _reach(footprint, azimuth) + radii[0] + 0.02 + 0.15 * rng.uniform()
    there = _turn(azimuth) @ make_pose(np.eye(3), [place, 0.0, 0.0])
    levels = [(0.0, height), (height, height + rng.uniform(0.1, 0.35))]
    solids = tuple(
        column(radius, sides, low, high).transformed(there)
        for radius, (low, high) in zip(radii, levels, strict=True)
    )
    return SceneSurroundings(solids, arc=(azimuth + np.pi, np.radians(110.0)))


def column(radius: float, sides: int, low: float, high: float) -> Mesh:
    """Return the upright prism of a regular polygon about the z axis from `low` to `high`."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    return _prism(radius * np.column_stack([np.cos(angle), np.sin(angle)]), low, high)


def _prism(outline: Array, first: float, second: float) -> Mesh:
    """Return the upright prism of a convex `outline` (n, 2) between two heights, metres."""
    return hull_of_points(on_levels(outline, first, second))


def _reach(footprint: Array, azimuth: float) -> float:
    """Return the reach of the objects from the origin along `azimuth`, metres."""
    return float((footprint @ [np.cos(azimuth), np.sin(azimuth)]).max())


def _turn(yaw: float) -> Array:
    return make_pose(rotation_about([0.0, 0.0, 1.0], yaw), np.zeros(3))
