"""Collision by FCL, against separating axes of every triangle and every box."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.mesh_collision import MeshCollider, hits_table
from tests.metrics.shapes import box, gripper, random_grasps

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=6, deadline=None)
ROUNDING = 1e-9  # metres; bodies nearer than that may touch or not


def made(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))


MESHES = {
    "box": box(0.06, 0.04, 0.1),
    "ball": made(trimesh.creation.icosphere(2, 0.03)),
    "cup": made(trimesh.creation.annulus(0.035, 0.038, 0.09, sections=40)),
    "torus": made(trimesh.creation.torus(0.04, 0.012, major_sections=24, minor_sections=12)),
}


def gap_to_box(triangles: np.ndarray, half: np.ndarray) -> float:
    """Return the gap of triangles (f, 3, 3) to a box at the origin along the best of 13 axes.

    Positive: every triangle is apart; negative: one triangle overlaps by at least that much.
    """
    edges = np.roll(triangles, -1, axis=1) - triangles
    normal = np.cross(edges[:, 0], edges[:, 1])[:, None]
    crosses = np.cross(edges[:, :, None], np.eye(3)[None, None]).reshape(-1, 9, 3)
    sides = np.broadcast_to(np.eye(3), (len(triangles), 3, 3))
    axes = np.concatenate([sides, normal, crosses], axis=1)
    length = np.linalg.norm(axes, axis=-1, keepdims=True)
    axes = np.where(length > 1e-12, axes / np.maximum(length, 1e-12), 0.0)
    seen = np.einsum("fai,fki->fak", axes, triangles)
    reach = np.abs(axes) @ half
    apart = np.maximum(seen.min(axis=-1) - reach, -reach - seen.max(axis=-1))
    return float(np.where(length[..., 0] > 1e-12, apart, -np.inf).max(axis=1).min())


def encloses(mesh: Mesh, point: np.ndarray) -> bool:
    """Return whether the solid angles of all triangles around `point` add up to a full sphere."""
    a, b, c = (mesh.triangles - point).swapaxes(0, 1)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ni,ni->n", u, v) for u, v in ((a, b), (b, c), (c, a)))
    turn = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return bool(abs(turn.sum()) > 2.0 * np.pi)


def naive_hit(mesh: Mesh, grasp: GraspPoses) -> bool | None:
    """Return whether the gripper touches or is in the mesh; None where rounding decides."""
    verdicts = []
    for low, high in gripper().boxes(grasp.width)[0]:
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        center = grasp.translation[0] + grasp.rotation[0] @ middle
        gap = gap_to_box((mesh.triangles - center) @ grasp.rotation[0], half)
        verdicts.append(None if abs(gap) < ROUNDING else gap < 0.0 or encloses(mesh, center))
    if any(verdicts):
        return True
    return None if None in verdicts else False


@pytest.mark.parametrize("shape", MESHES)
@given(seeds)
@few
def test_fcl_and_separating_axes_agree(shape, seed):
    rng = np.random.default_rng(seed)
    mesh, grasps = MESHES[shape], random_grasps(rng, 12, spread=0.08)
    widths = rng.uniform(0.005, 0.1, 12)
    grasps = GraspPoses(grasps.rotation, grasps.translation, widths)
    found = MeshCollider(mesh).hits(grasps, gripper())
    for row, hit in enumerate(found):
        expected = naive_hit(mesh, grasps[[row]])
        assert expected is None or hit == expected


def test_random_grasps_include_both_outcomes_and_enclosed_grippers():
    grasps = random_grasps(np.random.default_rng(0), 200, spread=0.08)
    for mesh in MESHES.values():
        assert 0.1 < MeshCollider(mesh).hits(grasps, gripper()).mean() < 0.95
    inside = GraspPoses(np.eye(3), np.zeros(3), np.array(0.04))
    assert naive_hit(box(1.0, 1.0, 1.0), inside) is True
    assert MeshCollider(box(1.0, 1.0, 1.0)).hits(inside, gripper()).all()


@given(seeds)
@few
def test_the_lowest_of_dense_samples_decides_on_collision_with_the_table(seed):
    rng = np.random.default_rng(seed)
    grasps = random_grasps(rng, 40, spread=0.08)
    T_table_grasps = make_pose(random_rotation(rng), rng.uniform(-0.05, 0.05, 3))
    share = np.stack(np.meshgrid(*[np.linspace(0, 1, 5)] * 3), -1).reshape(-1, 3)
    found = hits_table(grasps, gripper(), T_table_grasps)
    for row, boxes in enumerate(gripper().boxes(grasps.width)):
        local = (boxes[:, None, 0] + share * (boxes[:, None, 1] - boxes[:, None, 0])).reshape(-1, 3)
        at = grasps.translation[row] + local @ grasps.rotation[row].T
        lowest = (at @ T_table_grasps[:3, :3].T + T_table_grasps[:3, 3])[:, 2].min()
        assert abs(lowest) < ROUNDING or found[row] == (lowest < 0.0)
