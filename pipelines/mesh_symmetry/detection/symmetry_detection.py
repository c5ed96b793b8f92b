"""Detection of the symmetries of a mesh: up to three planes, one axis, one sphere (Sec. III-G).

Candidates are searched coarsely, refined, and accepted by the distance of the mesh's image from its
surface. A sphere implies all its planes and axes, a continuous axis all planes through it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, Symmetry
from pipelines.mesh_symmetry.detection.plane_sets import (
    ACROSS_COSINE,
    CLOSEST_PLANES,
    best_planes,
    consistent_planes,
    plane_across,
)
from pipelines.mesh_symmetry.detection.symmetry_candidates import DistanceGrid, axis_candidates
from pipelines.mesh_symmetry.detection.symmetry_search import (
    COARSE_SAMPLES,
    COARSE_SCALES,
    FINAL_SCALES,
    FINE_SAMPLES,
    FINE_SCALES,
    REFINEMENT_ANGLES,
    refined_axes,
    search_axes,
    search_planes,
)
from pipelines.mesh_symmetry.detection.symmetry_spheres import sphere_of
from pipelines.mesh_symmetry.detection.symmetry_verification import SurfaceFit
from pipelines.mesh_symmetry.detection.unit_surface import (
    UnitSurface,
    continuous_fit,
    fit_of_plane,
    fit_of_turn,
)
from pipelines.mesh_symmetry.surface.canonical_pose import CanonicalPose

LEAST_FAMILY = 4  # planes that meet in an axis
MEET_OFFSET = 0.015  # of the diameter, between an axis and a plane through it
IN_PLANE = float(np.sin(np.radians(4.0)))  # of the angle between an axis and a plane through it
LOSS_ROOM = 1.1  # times the former loss; by chance a better axis may miss more at the worst angle
PAIR_TOLERANCE = float(np.radians(2.0))  # of the angle between two planes that make a turn


@dataclass(frozen=True)
class MeshSymmetries:
    """The symmetries of the whole mesh, and the candidates that fit only a part of it."""

    symmetries: list[Symmetry]
    partial: list[Symmetry]
    dropped: tuple[Symmetry, ...] = ()  # found, but replaced or dropped since


def detect_symmetries(
    mesh: Mesh, config: AnnotateSymmetryConfig, rng: np.random.Generator
) -> list[Symmetry]:
    """Return the symmetries of `mesh`, metres, mesh frame: planes, then axis, or a sphere."""
    return analyse(mesh, config, rng).symmetries


def analyse(mesh: Mesh, config: AnnotateSymmetryConfig, rng: np.random.Generator) -> MeshSymmetries:
    """Return the symmetries of `mesh` and its rejected candidates (best first), mesh frame."""
    pose = CanonicalPose.of(mesh)
    found = _analyse(UnitSurface.from_mesh(pose.mesh, config, rng), config)
    return MeshSymmetries(
        [pose.given(each) for each in found.symmetries],
        [pose.given(each) for each in found.partial],
    )


def analyse_body(
    mesh: Mesh,
    guess: RotationSymmetry,
    config: AnnotateSymmetryConfig,
    rng: np.random.Generator,
    *,
    is_cut: bool = True,
) -> list[Symmetry]:
    """Return the symmetries of a body of revolution about `guess`, mesh frame.

    The result is a sphere, or the axis and, if the body has it, the mirror plane across the axis.
    The axis is refined if it is continuous for the whole surface, and stays `guess` if holes or
    noise hide this. A whole object (`is_cut` False) has no holes from cutting: without a continuous
    axis it has no symmetries.
    """
    pose = CanonicalPose.of(mesh)
    shape = UnitSurface.from_mesh(pose.mesh, config, rng)
    sphere = sphere_of(shape, config)
    if sphere is not None:
        return [pose.given(sphere)]
    known = pose.posed(guess)
    axis = np.concatenate([known.direction, (known.point - shape.center) / shape.size])
    for scales in (FINE_SCALES, FINAL_SCALES):
        better = refined_axes(shape, axis[None], REFINEMENT_ANGLES, scales, FINE_SAMPLES)[0]
        fit, continuous = continuous_fit(shape, better, config)
        if not continuous or abs(better[:3] @ known.direction) < ACROSS_COSINE:
            fit, continuous = continuous_fit(shape, axis, config)
            break
        axis = better
    if not is_cut and not continuous:
        return []
    found: list[Symmetry] = [
        _reflection(shape, plane, fit) for plane, fit in plane_across(shape, axis, [], config)
    ]
    return [pose.given(each) for each in [*found, _rotation(shape, axis, None, fit)]]


def holding(
    planes: Sequence[ReflectionSymmetry],
    mesh: Mesh,
    config: AnnotateSymmetryConfig,
    rng: np.random.Generator,
) -> list[ReflectionSymmetry]:
    """Return the `planes` that hold on `mesh`, mesh frame, with their errors on `mesh`."""
    if not planes:
        return []
    pose = CanonicalPose.of(mesh)
    shape = UnitSurface.from_mesh(pose.mesh, config, rng)
    held = []
    for plane in planes:
        known = pose.posed(plane)
        offset = known.direction @ (known.point - shape.center) / shape.size
        fit = fit_of_plane(shape, np.append(known.direction, offset), shape.samples)
        if fit.holds(config):
            held.append(replace(plane, error=fit.error))
    return held


def _analyse(shape: UnitSurface, config: AnnotateSymmetryConfig) -> MeshSymmetries:
    sphere = sphere_of(shape, config)
    if sphere is not None:
        return MeshSymmetries([sphere], [])
    grid = DistanceGrid.around(shape.surface.points, config.grid_resolution, config.distance_cap)
    axes, axis_fits = search_axes(shape, config)
    planes, plane_fits = search_planes(shape, grid, config)
    partial: list[Symmetry] = [
        _rotation(shape, axis, None, fit)
        for axis, (fit, is_continuous) in zip(axes, axis_fits, strict=True)
        if not is_continuous
    ]
    partial += [
        _reflection(shape, plane, fit)
        for plane, fit in zip(planes, plane_fits, strict=True)
        if not fit.holds(config)
    ]
    held = [each for each in zip(planes, plane_fits, strict=True) if each[1].holds(config)]
    continuous = [
        (axis, fit)
        for axis, (fit, is_continuous) in zip(axes, axis_fits, strict=True)
        if is_continuous
    ] or _round_by_planes(shape, [plane for plane, _ in held], config)
    rotation: RotationSymmetry | None
    if continuous:
        axis, fit = continuous[0]
        axis, fit = _finest_axis(shape, axis, fit, config)
        accepted = plane_across(shape, axis, held, config)
        rotation = _rotation(shape, axis, None, fit)
    else:
        accepted = consistent_planes(shape, held, config)
        rotation = _discrete_rotation(shape, grid, [plane for plane, _ in accepted], config)
    symmetries: list[Symmetry] = [
        _reflection(shape, plane, fit) for plane, fit in best_planes(shape, accepted, config)
    ]
    return MeshSymmetries(symmetries + ([rotation] if rotation is not None else []), partial)


def _finest_axis(
    shape: UnitSurface, axis: Array, fit: SurfaceFit, config: AnnotateSymmetryConfig
) -> tuple[Array, SurfaceFit]:
    """Return the continuous `axis` (6,) refined at the last scales, with its fit, if it fits."""
    finer = refined_axes(shape, axis[None], REFINEMENT_ANGLES, FINAL_SCALES, FINE_SAMPLES)[0]
    better, is_continuous = continuous_fit(shape, finer, config)
    fits = is_continuous and better.loss <= LOSS_ROOM * fit.loss
    return (finer, better) if fits else (axis, fit)


def _round_by_planes(
    shape: UnitSurface, planes: Sequence[Array], config: AnnotateSymmetryConfig
) -> list[tuple[Array, SurfaceFit]]:
    """Return the continuous axis through which most `planes` (4,) pass, with its fit, if any.

    The normals of grooves and dents mislead a search for axes, and holes move the centroid.
    """
    if len(planes) < LEAST_FAMILY:
        return []
    rows = np.stack(planes)
    lines = [
        _common_line(first, second)
        for first, second in combinations(planes, 2)
        if abs(first[:3] @ second[:3]) < np.cos(CLOSEST_PLANES)
    ]
    within = [
        (np.abs(rows[:, :3] @ line[:3]) < IN_PLANE)
        & (np.abs(rows[:, :3] @ line[3:] - rows[:, 3]) < MEET_OFFSET)
        for line in lines
    ]
    if not within or max(mask.sum() for mask in within) < LEAST_FAMILY:
        return []
    family = rows[max(within, key=np.count_nonzero)]
    direction = np.linalg.eigh(family[:, :3].T @ family[:, :3])[1][:, 0]
    point = np.linalg.lstsq(family[:, :3], family[:, 3], rcond=1e-3)[0]
    axis = np.concatenate([direction, point])
    fit, continuous = continuous_fit(shape, axis, config)
    return [(axis, fit)] if continuous else []


def _reflection(shape: UnitSurface, plane: Array, fit: SurfaceFit) -> ReflectionSymmetry:
    # The point of the plane nearest to the centroid.
    return ReflectionSymmetry(plane[:3], shape.to_mesh(plane[3] * plane[:3]), fit.error)


def _rotation(
    shape: UnitSurface, axis: Array, order: int | None, fit: SurfaceFit
) -> RotationSymmetry:
    foot = axis[3:] - (axis[3:] @ axis[:3]) * axis[:3]
    return RotationSymmetry(axis[:3], shape.to_mesh(foot), order, fit.error)


def _discrete_rotation(
    shape: UnitSurface, grid: DistanceGrid, planes: Sequence[Array], config: AnnotateSymmetryConfig
) -> RotationSymmetry | None:
    """Return the n-fold rotation of highest order: from pairs of planes, else by search."""
    turns = _turns_of_planes(shape, planes, config)
    # An object such as a propeller has a turn but no mirror.
    for order, axis in turns or _turns_by_search(shape, grid, config):
        angle = 2.0 * np.pi / order
        coarse = refined_axes(shape, axis[None], (angle,), COARSE_SCALES, COARSE_SAMPLES)
        if fit_of_turn(shape, coarse[0], angle, shape.few).is_hopeless(config):
            continue
        refined = refined_axes(shape, coarse, (angle,), FINE_SCALES, FINE_SAMPLES)[0]
        fit = fit_of_turn(shape, refined, angle, shape.samples)
        if fit.holds(config):
            return _rotation(shape, refined, order, fit)
    return None


def _turns_of_planes(
    shape: UnitSurface, planes: Sequence[Array], config: AnnotateSymmetryConfig
) -> list[tuple[int, Array]]:
    """Return order and axis (6,) of the turns that pairs of `planes` make, the best guess first.

    Mirroring in two planes at an angle of pi / n is a turn by 2 pi / n about their common line.
    """
    turns = []
    for first, second in combinations(planes, 2):
        between = np.arccos(np.clip(abs(first[:3] @ second[:3]), 0.0, 1.0))
        order = int(np.clip(np.round(np.pi / max(float(between), 1e-3)), 2, config.max_order))
        if abs(between - np.pi / order) < PAIR_TOLERANCE:
            turns.append((order, _common_line(first, second)))

    def rank(turn: tuple[int, Array]) -> tuple[int, float]:
        # Among a box's three half turns, prefer the turn about its longest side.
        return turn[0], float(np.ptp(shape.samples.points @ turn[1][:3]).round(2))

    return sorted(turns, key=rank, reverse=True)


def _turns_by_search(
    shape: UnitSurface, grid: DistanceGrid, config: AnnotateSymmetryConfig
) -> Iterator[tuple[int, Array]]:
    """Yield each order, the highest first, and its best axis (6,) through the centroid."""
    points = shape.points(COARSE_SAMPLES)
    for order in range(config.max_order, 1, -1):
        best = axis_candidates(grid, points, config, (2.0 * np.pi / order,))[0]
        yield order, np.concatenate([best, np.zeros(3)])


def _common_line(first: Array, second: Array) -> Array:
    direction = np.cross(first[:3], second[:3])
    system = np.stack([first[:3], second[:3], direction])
    point = np.linalg.solve(system, [first[3], second[3], 0.0])
    return np.concatenate([direction / np.linalg.norm(direction), point])
