"""Grasps scored per CPU-second relative to graspnetAPI, collision checks, frames of its AP."""

import numpy as np
import trimesh

from benchmarks.timing import Measurement, cpu_seconds_of, seconds_of
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.numerics.single_precision import single_precision_grid
from pipelines.geometry.rendering import first_hits
from pipelines.geometry.transforms import make_pose, random_rotation, unit
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses, to_graspnet
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid
from pipelines.metrics.graspnet.box_collision import NUM_CLOUD_SAMPLES, voxel_means
from pipelines.metrics.graspnet.graspnet_ap import AP_FRICTIONS
from pipelines.metrics.graspnet.graspnet_frames import GridObject, GridScene, score_rows
from pipelines.metrics.graspnet.grid_contacts import close_fingers_on_grid
from pipelines.metrics.mesh_collision import MeshCollider

NUM_GRASPS = 4000
NUM_COLLIDED = 500
NUM_ROWS = 1024  # grasps of a frame, as in a detector's dump
DEPTH = 0.02  # metres from GraspNet's origin to the finger tips
COPIES = 3  # copies of each shape in a frame
SHAPES = {
    "box": trimesh.creation.box((0.06, 0.04, 0.1)),
    "can": trimesh.creation.cylinder(0.03, 0.1, sections=128),
    "ball": trimesh.creation.icosphere(4, 0.035),
}
# Grasps per CPU-second of graspnetAPI's get_grasp_score on the same kinds of shape and grasp.
GRASPNETAPI = {
    ("box", "antipodal"): 23.4,
    ("box", "label"): 44.6,
    ("can", "antipodal"): 20.2,
    ("can", "label"): 44.9,
    ("ball", "antipodal"): 16.0,
    ("ball", "label"): 30.2,
}
GRASPNETAPI_FRAMES = 1.0 / 1.7  # frames per CPU-second of its whole evaluation


def measure() -> list[Measurement]:
    """Return rates on three shapes and two kinds of grasps, the slowest relative to graspnetAPI."""
    rng = np.random.default_rng(0)
    meshes = {
        name: Mesh(np.asarray(made.vertices), np.asarray(made.faces))
        for name, made in SHAPES.items()
    }
    collider, gripper = MeshCollider(meshes["ball"]), load_gripper("rg2")
    few = _grasps(meshes["ball"], "label", rng)[:NUM_COLLIDED]
    checked = NUM_COLLIDED / seconds_of(lambda: collider.hits(few, gripper))
    return [
        *_scoring(meshes, rng),
        Measurement("grasps checked for collision", checked, "1/s", "one mesh, three boxes"),
        _frames(meshes, rng),
    ]


def _scoring(meshes: dict[str, Mesh], rng: np.random.Generator) -> list[Measurement]:
    exact, compatible = {}, {}
    for name, kind in GRASPNETAPI:
        mesh, grid = meshes[name], single_precision_grid(meshes[name])
        grasps = _grasps(mesh, kind, rng)
        exact[name, kind] = NUM_GRASPS / cpu_seconds_of(
            lambda m=mesh, g=grasps: on_grid(
                min_friction(close_fingers(m, g, g.width)), AP_FRICTIONS
            )
        )
        compatible[name, kind] = NUM_GRASPS / cpu_seconds_of(
            lambda d=grid, g=grasps: on_grid(
                min_friction(close_fingers_on_grid(d, g, g.width)), AP_FRICTIONS
            )
        )
    return [_against_graspnetapi("", exact), _against_graspnetapi(", compatible", compatible)]


def _against_graspnetapi(mode: str, rates: dict[tuple[str, str], float]) -> Measurement:
    times = {case: rate / GRASPNETAPI[case] for case, rate in rates.items()}
    worst = min(times, key=lambda case: times[case])
    note = f"{times[worst]:,.0f} to {max(times.values()):,.0f} times graspnetAPI's CPU-second"
    return Measurement(f"grasps scored{mode}", rates[worst], "1/CPU s", f"{note}, six cases")


def _frames(meshes: dict[str, Mesh], rng: np.random.Generator) -> Measurement:
    """Return the rate of frames of nine objects scored by GraspNet's protocol, without files."""
    kinds = [
        GridObject(
            voxel_means(sample_surface(mesh, NUM_CLOUD_SAMPLES, rng)[0]),
            single_precision_grid(mesh),
        )
        for mesh in meshes.values()
    ]
    objects, poses, rows = kinds * COPIES, [], []
    for place, mesh in enumerate([*meshes.values()] * COPIES):
        pose = make_pose(np.eye(3), [0.13 * (place // COPIES), 0.13 * (place % COPIES), 0.05])
        poses.append(pose.astype(np.float32))
        grasps = _grasps(mesh, "antipodal", rng)[: NUM_ROWS // len(objects)].transformed(pose)
        rows.append(to_graspnet(grasps, rng.random(len(grasps)), depth=DEPTH, tip_reach=0.0))
    scene, every = GridScene(objects, poses, np.eye(4)), np.concatenate(rows)
    rate = 1.0 / cpu_seconds_of(lambda: score_rows(every, scene))
    note = f"{rate / GRASPNETAPI_FRAMES:.0f} times graspnetAPI; {len(every)} grasps, nine objects"
    return Measurement("frames of GraspNet's AP", rate, "1/CPU s", note)


def _grasps(mesh: Mesh, kind: str, rng: np.random.Generator) -> GraspPoses:
    """Return grasps across the mesh, nearly antipodal, or at any angle as GraspNet's labels."""
    points, normals, _ = sample_surface(mesh, NUM_GRASPS, rng)
    if kind == "label":
        rotation = np.stack([random_rotation(rng) for _ in range(NUM_GRASPS)])
        depth = rng.integers(1, 5, (NUM_GRASPS, 1)) * 0.01
        opening = rng.uniform(0.02, 0.1, NUM_GRASPS)
        return GraspPoses(rotation, points + depth * rotation[:, :, 0], opening)
    closing = unit(-normals + 0.1 * rng.normal(size=points.shape))
    across = first_hits(mesh, points + 1e-5 * closing, closing)[0]
    across = np.where(np.isfinite(across), across, 0.0)
    far = points + across[:, None] * closing
    grasps = GraspPoses.from_contacts(np.stack([points, far], 1), rng.normal(size=points.shape))
    return GraspPoses(grasps.rotation, grasps.translation, np.minimum(grasps.width + 0.02, 0.1))
