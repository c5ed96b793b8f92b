"""Shapes whose symmetries are known by construction; metres, centred at the origin."""

import numpy as np
import trimesh

from pipelines.geometry.meshes.mesh import Mesh


def mesh_of(made):
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def box(x=0.12, y=0.08, z=0.05):
    return mesh_of(trimesh.creation.box((x, y, z)))


def cylinder(radius=0.03, height=0.1, sections=64):
    return mesh_of(trimesh.creation.cylinder(radius, height, sections=sections))


def hex_prism(radius=0.03, height=0.1):
    return cylinder(radius, height, sections=6)


def ball(radius=0.04):
    return mesh_of(trimesh.creation.icosphere(3, radius))


def prism(outline, height=0.04):
    """The extrusion of a polygon without holes, corners counter-clockwise."""
    corners = np.asarray(outline, float) - np.mean(outline, axis=0)
    made = trimesh.creation.extrude_triangulation(
        corners, fan_or_ears(corners), height, engine=None
    )
    return mesh_of(made)


def fan_or_ears(corners):
    """Triangulate a simple polygon by cutting ears."""
    left, triangles = list(range(len(corners))), []
    while len(left) > 3:
        for at in range(len(left)):
            a, b, c = left[at - 1], left[at], left[(at + 1) % len(left)]
            if is_ear(corners, a, b, c, left):
                triangles.append((a, b, c))
                left.pop(at)
                break
    return np.array([*triangles, left])


def is_ear(corners, a, b, c, left):
    def area(p, q, r):
        (px, py), (qx, qy), (rx, ry) = corners[p], corners[q], corners[r]
        return (qx - px) * (ry - py) - (qy - py) * (rx - px)

    if area(a, b, c) <= 0:
        return False
    others = [d for d in left if d not in (a, b, c)]
    return not any(min(area(a, b, d), area(b, c, d), area(c, a, d)) >= 0 for d in others)


def l_shape(long=0.12, short=0.07, thick=0.03):
    """An L with arms of two lengths: the plane across its thickness is its only mirror."""
    return prism([(0, 0), (long, 0), (long, thick), (thick, thick), (thick, short), (0, short)])


def pebble():
    """The convex hull of a few scattered points, without a symmetry."""
    points = np.random.default_rng(7).normal(size=(14, 3)) * (0.05, 0.03, 0.02)
    return mesh_of(trimesh.convex.convex_hull(points))


def ball_beside_box():
    """A ball and a tilted box, unconnected, without a symmetry of the whole."""
    parts = [trimesh.creation.icosphere(3, 0.03), trimesh.creation.box((0.03, 0.05, 0.09))]
    turn = trimesh.transformations.rotation_matrix(1.1, (0.3, 1.0, 0.2), (0.0, 0.0, 0.0))
    turn[:3, 3] = (0.085, 0.02, 0.03)
    parts[1].apply_transform(turn)
    return mesh_of(trimesh.util.concatenate(parts))


def sheet(outline, cells=16):
    """One layer of triangles over a star-shaped polygon about the origin, in the plane z = 0."""
    corners = np.asarray(outline, float)
    rings = np.linspace(0.0, 1.0, cells + 1)[:, None, None] * corners
    vertices = np.pad(rings.reshape(-1, 2), ((0, 0), (0, 1)))
    count = len(corners)
    inner = (np.arange(cells)[:, None] * count + np.arange(count)).reshape(-1)
    beside = (np.arange(cells)[:, None] * count + (np.arange(count) + 1) % count).reshape(-1)
    faces = np.concatenate(
        [
            np.column_stack([inner, inner + count, beside + count]),
            np.column_stack([inner, beside + count, beside]),
        ]
    )
    return Mesh(vertices, faces)


def card(x=0.0856, y=0.054):
    """A rectangle like a bank card, without thickness."""
    return sheet(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (0.5 * x, 0.5 * y))


def disc(radius=0.04, sections=64):
    """A disc without thickness."""
    angle = np.arange(sections) * 2.0 * np.pi / sections
    return sheet(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def hollow_ball(radius=0.033, wall=0.0033):
    """A ball with a wall: two concentric skins, the inner looking inwards."""
    outer, inner = (trimesh.creation.icosphere(3, r) for r in (radius, radius - wall))
    inner.invert()
    return mesh_of(trimesh.util.concatenate([outer, inner]))


def box_at(size, place):
    """A box of edges `size` about `place`."""
    made = trimesh.creation.box(size)
    made.apply_translation(place)
    return made


def pronged_column():
    """A column with a block on one side, and a prong on the block to one side: no mirror at all."""
    parts = [
        trimesh.creation.cylinder(0.03, 0.12, sections=64),
        box_at((0.04, 0.02, 0.06), (0.048, 0.0, 0.0)),
        box_at((0.02, 0.03, 0.02), (0.055, 0.024, 0.01)),
    ]
    return mesh_of(trimesh.util.concatenate(parts))


def crossed_columns():
    """Two columns next to each other, unconnected, at right angles."""
    lying = trimesh.creation.cylinder(0.02, 0.09, sections=64)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2.0, (1.0, 0.2, 0.0))
    turn[:3, 3] = (0.1, 0.01, 0.0)
    lying.apply_transform(turn)
    standing = trimesh.creation.cylinder(0.02, 0.06, sections=64)
    return mesh_of(trimesh.util.concatenate([standing, lying]))


def finned_box():
    """A box with a small fin on one side near a corner, which no plane of the box maps to itself.

    The fin is some 2 % of the area.
    """
    parts = [
        trimesh.creation.box((0.12, 0.08, 0.05)),
        box_at((0.01, 0.03, 0.004), (0.05, 0.055, 0.02)),
    ]
    return mesh_of(
        trimesh.util.concatenate([parts[0].subdivide().subdivide().subdivide(), parts[1]])
    )


def three_boxes():
    """Three long boxes that run into each other, of 12 triangles each; no mirror at all."""
    sizes = [(0.05, 0.03, 0.02), (0.02, 0.06, 0.02), (0.02, 0.02, 0.07)]
    places = [(0.0, 0.0, 0.0), (0.03, 0.03, 0.0), (-0.02, 0.0, 0.035)]
    boxes = [box_at(size, place) for size, place in zip(sizes, places, strict=True)]
    return mesh_of(trimesh.util.concatenate(boxes))
