"""Shapes whose symmetries are known by construction; metres, centred at the origin."""

import numpy as np
import trimesh

from pipelines.geometry.mesh import Mesh


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
    """The convex hull of a few scattered points: nothing symmetric."""
    points = np.random.default_rng(7).normal(size=(14, 3)) * (0.05, 0.03, 0.02)
    return mesh_of(trimesh.convex.convex_hull(points))


def ball_beside_box():
    """A ball and a tilted box, unconnected, of which nothing whole is symmetric."""
    parts = [trimesh.creation.icosphere(3, 0.03), trimesh.creation.box((0.03, 0.05, 0.09))]
    turn = trimesh.transformations.rotation_matrix(1.1, (0.3, 1.0, 0.2), (0.0, 0.0, 0.0))
    turn[:3, 3] = (0.085, 0.02, 0.03)
    parts[1].apply_transform(turn)
    return mesh_of(trimesh.util.concatenate(parts))
