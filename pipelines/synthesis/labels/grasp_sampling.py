"""Grasp labels of a mesh by sampling and validation, on GraspNet-1Billion's grid.

Points are drawn from the surface. Candidates of a point are 300 views, 12 angles about the approach
and 4 depths of the finger tips. The fingers close on the line through their tips; a candidate holds
if both fingers touch the object from outside, each on its side of the line's middle, and the
closed form of force closure gives a friction of at most 1. Its opening is the smallest that holds
without collision (D. 38).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.configs import LabelConfig
from pipelines.dataset.graspnet.graspnet_labels import LABEL_GRID, GraspLabel, label_offsets
from pipelines.dataset.graspnet.graspnet_views import GRASP_DEPTHS, generate_views, view_rotations
from pipelines.errors import ValueRangeError
from pipelines.geometry.meshes.line_crossings import Crossings, line_crossings
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.meshes.surface_patches import SurfacePatches
from pipelines.geometry.transforms import invert, transform_points
from pipelines.metrics.force_closure import on_grid
from pipelines.synthesis.labels.graspnet_gripper import hits_plane, hits_surface
from pipelines.synthesis.labels.openings import openings

INFEASIBLE = -1.0  # GraspNet's value for a candidate that holds at no friction
NUM_BOUNDS = 60  # planes around the mesh; a line with its middle beyond a plane has no contacts


@dataclass(frozen=True)
class LabelTarget:
    """A mesh prepared for labelling."""

    mesh: Mesh  # object frame, metres
    surface: SurfacePatches
    directions: Array  # (k, 3) unit vectors
    bounds: Array  # (2, k) lowest and highest coordinate of the mesh along `directions`

    @classmethod
    def from_mesh(cls, mesh: Mesh) -> "LabelTarget":
        """Prepare `mesh`."""
        directions = generate_views(NUM_BOUNDS).astype(np.float64)
        along = mesh.vertices[np.unique(mesh.faces)] @ directions.T
        bounds = np.stack([along.min(axis=0), along.max(axis=0)])
        return cls(mesh, SurfacePatches.from_mesh(mesh), directions, bounds)

    def may_enclose(self, points: Array) -> Mask:
        """Return a mask (...) of `points` (..., 3) that may lie between two points of the mesh."""
        along = points @ self.directions.T
        return np.asarray(((along >= self.bounds[0]) & (along <= self.bounds[1])).all(axis=-1))


def sample_grasp_label(mesh: Mesh, config: LabelConfig, rng: np.random.Generator) -> GraspLabel:
    """Return the grasp label of `config.num_points` points of `mesh`, object frame, metres."""
    points = sample_surface(mesh, config.num_points, rng)[0].astype(np.float32)
    return label_points(LabelTarget.from_mesh(mesh), points, config)


def label_points(target: LabelTarget, points: Singles, config: LabelConfig) -> GraspLabel:
    """Return the grasp label of `points` (p, 3) on the surface of `target`, object frame, metres.

    `collision` is between the gripper and the object itself; infeasible candidates are not tested
    and count as in collision. A width is the opening, which clears the farther contact by half of
    `config.width_margin` on each side; it is 0 if no opening has two contacts.
    """
    _check_grid(config)
    shape = (len(points), *LABEL_GRID)
    friction, width = np.full(shape, INFEASIBLE, np.float32), np.zeros(shape, np.float32)
    collision = np.ones(shape, np.bool_)
    # Friction and collision are computed for the rounded points, as in the file.
    for i, point in enumerate(points.astype(np.float64)):
        friction[i], width[i], collision[i] = _label_point(target, point, config)
    return GraspLabel(points, label_offsets(width), collision, friction)


def _check_grid(config: LabelConfig) -> None:
    grid = (config.num_views, config.num_angles, len(config.depths))
    if grid != LABEL_GRID or not np.allclose(config.depths, GRASP_DEPTHS):
        found = f"{grid} with depths {config.depths}"
        expected = f"{LABEL_GRID} with depths {tuple(GRASP_DEPTHS.tolist())}, GraspNet's"
        raise ValueRangeError("views, angles and depths of grasp labels", found, expected)


def _label_point(
    target: LabelTarget, point: Array, config: LabelConfig
) -> tuple[Singles, Singles, Mask]:
    """Return friction on the grid, opening and collision (300, 12, 4) of a point's candidates."""
    friction, width = np.full(LABEL_GRID, INFEASIBLE, np.float32), np.zeros(LABEL_GRID, np.float32)
    collision = np.ones(LABEL_GRID, np.bool_)
    for index, below, above in _lines(target, point, config):
        found = openings(below, above, config.width_margin / 2.0, config.max_width / 2.0)
        smallest = found.half.min(axis=1, initial=np.inf)
        width[tuple(index)] = np.where(np.isfinite(smallest), 2.0 * smallest, 0.0)
        holding = found.limited(max(config.friction_grid))
        for column in range(holding.half.shape[1]):
            # Take the smallest opening, unless it collides with the object and a wider does not.
            open_ = np.isfinite(holding.half[:, column]) & collision[tuple(index)]
            if not open_.any():
                break
            at = tuple(index[:, open_])
            trial = np.zeros(LABEL_GRID, np.float32)
            trial[at] = 2.0 * holding.half[open_, column]
            hit = hits_surface(target.surface, point, trial > 0.0, trial)
            taken = ~hit[at] if column else np.ones(len(at[0]), np.bool_)
            at = tuple(index[:, open_][:, taken])
            width[at], collision[at] = trial[at], hit[at]
            friction[at] = on_grid(holding.friction[open_, column][taken], config.friction_grid)
    return friction, width, collision


def _lines(
    target: LabelTarget, point: Array, config: LabelConfig
) -> Iterator[tuple[Indices, Crossings, Crossings]]:
    """Yield the lines of a point's candidates that exit the object on both sides of their middle.

    Yields candidates (3, n), and the crossings of their lines toward -closing and +closing; first
    for lines with one surface on each side, then for the other lines.
    """
    rotation = view_rotations().astype(np.float64)
    tips = point + GRASP_DEPTHS[:, None] * rotation[:, 0, None, :, 0]  # (300, 4, 3)
    enclosed = np.broadcast_to(target.may_enclose(tips)[:, None], LABEL_GRID)
    index = np.stack(np.nonzero(enclosed))
    sides: list[Crossings] = []
    for direction in (-1.0, 1.0):
        view, angle, depth = index
        closing = direction * rotation[view, angle, :, 1]
        side = line_crossings(target.mesh, tips[view, depth], closing, config.max_width / 2.0)
        leaving = side.leave.any(axis=1)
        index, sides = index[:, leaving], [each[leaving] for each in (*sides, side)]
    below, above = sides
    single = (below.count == 1) & (above.count == 1)
    for group in (single, ~single):
        if group.any():
            yield index[:, group], below[group], above[group]


def scene_collisions(
    labels: Sequence[GraspLabel],  # object frames
    meshes: Sequence[Mesh],  # of the same objects, object frames
    poses_world: Sequence[ArrayLike],  # (4, 4) each, object to world; z of the world points up
    *,
    table_height: float = 0.0,  # z of the table's top in the world, metres
    surroundings: Sequence[Mesh] = (),  # obstacles except objects, world frame
) -> list[Mask]:
    """Return a scene's collision labels, (P_i, 300, 12, 4) for each object.

    True if the gripper collides with another object, the table or the surroundings, or if the
    object's label is infeasible or in collision with the object itself.
    """
    fixed = [SurfacePatches.from_mesh(each) for each in surroundings]
    poses = [np.asarray(pose, np.float64) for pose in poses_world]
    surfaces = [
        SurfacePatches.from_mesh(mesh).transformed(pose)
        for mesh, pose in zip(meshes, poses, strict=True)
    ]
    collisions = []
    for i, (label, pose) in enumerate(zip(labels, poses, strict=True)):
        others = SurfacePatches.concatenate([s for j, s in enumerate(surfaces) if j != i] + fixed)
        others = others.transformed(invert(pose))
        width = label.offsets[..., 2]
        height = transform_points(pose, label.points)[:, 2] - table_height
        hit = label.collision | (label.min_friction <= 0) | hits_plane(width, pose[2, :3], height)
        for row, point in enumerate(label.points.astype(np.float64)):
            hit[row] |= hits_surface(others, point, ~hit[row], width[row])
        collisions.append(np.asarray(hit))
    return collisions
