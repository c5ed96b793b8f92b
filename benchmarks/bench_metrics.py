"""Grasps scored a second: exact contacts and closed-form friction, and collision beside it."""

import numpy as np
import trimesh

from benchmarks.timing import Measurement, seconds_of
from pipelines.formats.gripper_files import load_gripper
from pipelines.geometry.mesh import Mesh
from pipelines.geometry.single_precision import single_precision_grid
from pipelines.geometry.transforms import random_rotation
from pipelines.grasping.grasps import Grasps
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction
from pipelines.metrics.grid_contacts import close_fingers_on_grid
from pipelines.metrics.mesh_collision import MeshCollider

NUM_GRASPS = 10000
NUM_COLLIDED = 500
PEER = 23.0  # grasps a CPU-second, graspnetAPI's get_grasp_score on near-antipodal grasps of a box


def measure() -> list[Measurement]:
    """Return rates on a ball of 5,120 triangles, as many as the peer was measured on."""
    shape = trimesh.creation.icosphere(4, 0.035)
    mesh = Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))
    rng = np.random.default_rng(0)
    rotation = np.stack([random_rotation(rng) for _ in range(NUM_GRASPS)])
    offset = rng.uniform(-0.02, 0.02, (NUM_GRASPS, 3))
    grasps = Grasps(rotation, offset, np.full(NUM_GRASPS, 0.075))
    collider, gripper, few = MeshCollider(mesh), load_gripper("rg2"), grasps[:NUM_COLLIDED]
    scored = NUM_GRASPS / seconds_of(lambda: min_friction(close_fingers(mesh, grasps, 0.08)))
    checked = NUM_COLLIDED / seconds_of(lambda: collider.hits(few, gripper))
    grid = single_precision_grid(mesh)
    compatible = NUM_GRASPS / seconds_of(
        lambda: min_friction(close_fingers_on_grid(grid, grasps, 0.08))
    )
    return [
        Measurement(
            "grasps scored, compatible",
            compatible,
            "1/s",
            f"{compatible / PEER:.0f} times graspnetAPI's CPU-second",
        ),
        Measurement("grasps scored", scored, "1/s", f"graspnetAPI: {PEER:.0f} a CPU-second"),
        Measurement("grasps checked for collision", checked, "1/s", "one mesh, three boxes"),
    ]
