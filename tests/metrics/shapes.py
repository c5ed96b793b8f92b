"""Shapes, grasps and a gripper for the tests of metrics; sides along the axes, centred."""

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.transforms import random_rotation, transform_points
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper

Array = NDArray[np.float64]


def box(x: float, y: float, z: float) -> Mesh:
    made = trimesh.creation.box((x, y, z))
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def ball(radius: float) -> Mesh:
    made = trimesh.creation.icosphere(3, radius)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def moved(mesh: Mesh, T: Array) -> Mesh:
    return Mesh(transform_points(T, mesh.vertices), mesh.faces)


def surface(mesh: Mesh, count: int = 20000) -> tuple[Array, Array]:
    points, normals, _ = sample_surface(mesh, count, np.random.default_rng(0))
    return points, normals


def random_grasps(rng: np.random.Generator, count: int, spread: float) -> GraspPoses:
    """Grasps at any angle, 5 cm wide, with midpoints up to `spread` from the origin."""
    rotation = np.stack([random_rotation(rng) for _ in range(count)])
    return GraspPoses(rotation, rng.uniform(-spread, spread, (count, 3)), np.full(count, 0.05))


def gripper() -> Gripper:
    """A plain hand: 12 cm opening, 1 cm fingers, 1 cm of clearance on each side."""
    sizes = {"finger_length": 0.05, "finger_thickness": 0.01, "finger_height": 0.02}
    palm = {"palm_depth": 0.06, "palm_width": 0.08, "palm_height": 0.04}
    reach = {"tip_reach": 0.005, "clearance": 0.01, "flange_to_tip": 0.2, "max_opening": 0.12}
    return Gripper(name="plain", **sizes, **palm, **reach)
