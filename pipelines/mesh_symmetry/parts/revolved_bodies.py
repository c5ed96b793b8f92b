"""Bodies of revolution among the parts of a surface: a mug's wall, a pan, a hammer's handle.

Patches propose an axis (`patch_axes.py`); the body is the connected set of samples on full, round
circles about it. Flat samples fit every axis across them, so they belong to a body only if the body
bounds them, as a mug bounds its bottom; the flats of a nut do not. A body must end at an edge:
the middle of a banana is round, but has no visible end.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.geometry.meshes.diameter import diameter
from pipelines.mesh_symmetry.parts.patch_axes import refined, revolution_axes, same_line
from pipelines.mesh_symmetry.parts.sampled_parts import SampledParts
from pipelines.mesh_symmetry.surface.cylinder_profile import Axis, profile

MAX_BODIES = 4
FLAT_SINE = float(np.sin(np.radians(15.0)))  # between normal and axis
SAME_FLAT = 0.9  # cosine; the two sides of a plate are two flats
MIN_BOUNDED = 2.0 / 3.0  # least share of links around a flat to its body
MAX_SMOOTH_BORDER = 0.8  # largest share of a body's border without an edge
MAX_STRAYS = 0.02  # of a body: samples inside it that were missed by chance
MIN_LATERAL = 0.15  # least share of a body that is not flat; below, the body is a disc on a plate


@dataclass(frozen=True)
class Body:
    """A body of revolution: axis, frame and unit of the mesh, and its samples `members` (m,).

    `lateral` is the body's share of the surface, 0 to 1, with samples weighted by the sine between
    normal and axis: the part on which fingers close across the axis.
    """

    axis: Axis
    members: Mask
    lateral: float


def revolved_bodies(parts: SampledParts, among: Mask, min_lateral: float) -> list[Body]:
    """Return the bodies of revolution of at least `min_lateral`, the largest first.

    Bodies are searched `among` (m,) the samples, each in the rest that earlier bodies left.
    """
    center = parts.surface.points.mean(axis=0)
    size = diameter(parts.surface.points)
    points, normals = (parts.surface.points - center) / size, parts.surface.normals
    left = among.copy()
    bodies: list[Body] = []
    while len(bodies) < MAX_BODIES and left.mean() > min_lateral:
        best = _largest_body(parts, points, normals, left, min_lateral)
        if best is None:
            break
        axis = Axis(best.axis.direction, best.axis.point * size + center)
        bodies.append(replace(best, axis=axis))
        left &= ~best.members
    return bodies


def _largest_body(
    parts: SampledParts, points: Array, normals: Array, left: Mask, min_lateral: float
) -> Body | None:
    """Return the largest body among `left` (n,), of at least `min_lateral`."""
    bodies: list[Body] = []
    fits: list[Axis] = []
    for axis in revolution_axes(points[left], normals[left]):
        if any(same_line(axis, known) for known in fits):
            continue
        fitted, held_left = refined(axis, points[left], normals[left])
        fits.append(fitted)
        held = np.zeros(len(points), dtype=np.bool_)
        held[left] = held_left
        body = _grown(parts, fitted, points, normals, held, min_lateral)
        if body is not None:
            bodies.append(body)
    return max(bodies, key=lambda body: body.lateral, default=None)


def _grown(
    parts: SampledParts, axis: Axis, points: Array, normals: Array, held: Mask, min_lateral: float
) -> Body | None:
    """Return the body about `axis` that is the largest connected part of `held` (n,)."""
    lateral = profile(axis, points, normals).lateral
    enough = min_lateral * lateral.sum()
    if lateral[held].sum() < enough:
        return None
    held = _without_loose_flats(parts, parts.smoothed(held) & held, lateral)
    if not held.any():
        return None
    members = _with_strays(parts, parts.clusters(held)[0])
    if lateral[members].mean() < MIN_LATERAL or parts.smooth_border(members) > MAX_SMOOTH_BORDER:
        return None
    inside = float(lateral[members].sum())
    return Body(axis, members, inside / float(lateral.sum())) if inside >= enough else None


def _with_strays(parts: SampledParts, members: Mask) -> Mask:
    """Return `members` (n,) with the few samples inside them that were missed by chance.

    Otherwise a body that is a whole object would border on these samples only, without an edge.
    """
    filled = members.copy()
    for stray in parts.clusters(~members):
        alone = parts.touching(stray, ~members & ~stray) == 0.0
        few = stray.sum() <= MAX_STRAYS * members.sum()
        if few and alone and parts.touching(stray, members) > 0.0:
            filled |= stray
    return filled


def _without_loose_flats(parts: SampledParts, held: Mask, lateral: Array) -> Mask:
    """Return `held` without flats that other parts bound."""
    flat = held & (lateral < FLAT_SINE)
    kept = held.copy()
    for members in parts.clusters(flat, SAME_FLAT):
        inside = parts.touching(members, held & ~members)
        outside = parts.touching(members, ~held)
        if inside < MIN_BOUNDED * (inside + outside):
            kept &= ~members
    return kept
