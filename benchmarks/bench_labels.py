"""Grasp labels: candidates per CPU-second, compared with a version that tries them one by one."""

import time

import numpy as np
import trimesh

from benchmarks.timing import Measurement
from pipelines.configs import LabelConfig
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.meshes.signed_distance import signed_distance_grid
from pipelines.synthesis.labels.grasp_sampling import LabelTarget, label_points
from tests.synthesis import naive_labels

NUM_POINTS, NUM_NAIVE = 24, 400
FULL_LABEL = 3458 * 300 * 12 * 4  # candidates of GraspNet-1Billion's object 000


def measure() -> list[Measurement]:
    """Return rates on a dented ball of 8 cm and 5,120 triangles."""
    mesh = _dented_ball()
    points = sample_surface(mesh, NUM_POINTS, np.random.default_rng(0))[0].astype(np.float32)
    target = LabelTarget.from_mesh(mesh)
    started = time.process_time()
    label = label_points(target, points, LabelConfig())
    rate = label.min_friction.size / (time.process_time() - started)
    slow = _naive_rate(mesh, points, label.min_friction.shape)
    started = time.process_time()
    signed_distance_grid(mesh)
    grid = time.process_time() - started
    note = f"{FULL_LABEL / rate:.0f} CPU-s for 49.8 million; one by one: {slow:.0f}/s"
    return [
        Measurement("label-grasps, candidates", rate, "1/CPU-s", note),
        Measurement("label-grasps, against one by one", rate / slow, "times", "the tests' check"),
        Measurement("textured.sdf, 100 x 100 x 100", grid, "CPU-s", "one mesh"),
    ]


def _naive_rate(mesh: Mesh, points: np.ndarray, shape: tuple[int, ...]) -> float:
    rng = np.random.default_rng(1)
    candidates = np.stack([rng.integers(0, n, NUM_NAIVE) for n in shape], axis=1).tolist()
    started = time.process_time()
    for point, view, angle, depth in candidates:
        naive_labels.label(mesh.triangles, points[point].astype(float), view, angle, depth)
    return NUM_NAIVE / (time.process_time() - started)


def _dented_ball() -> Mesh:
    shape = trimesh.creation.icosphere(4, 0.04)
    dents = 1.0 + 0.1 * np.sin(120.0 * shape.vertices).sum(axis=1, keepdims=True)
    return Mesh(shape.vertices * dents, np.asarray(shape.faces))
