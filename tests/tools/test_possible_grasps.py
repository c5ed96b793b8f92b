"""Possible grasps among true meshes: boxes that stand, lie or are walled in."""

import numpy as np

from pipelines.metrics.grasp_verdicts import TrueObject, TrueScene
from pipelines.metrics.mesh_collision import MeshCollider
from tests.metrics.shapes import ball, box, gripper, surface
from tools import possible_grasps as possible

STANDING, SLAB = (0.04, 0.05, 0.10), (0.20, 0.15, 0.004)  # metres
# Walls higher than the box, a millimetre from each of its sides.
ALONG_X, ALONG_Y = (0.12, 0.018, 0.3), (0.018, 0.05, 0.3)
WALLS = [(ALONG_X, 0, s * 0.035) for s in (-1, 1)] + [(ALONG_Y, s * 0.03, 0) for s in (-1, 1)]


def true_scene(*placed):
    """Boxes (size, x, y) that stand on the table of the camera frame, z up."""
    objects, poses = {}, {}
    for each, (size, x, y) in enumerate(placed):
        mesh, pose = box(*size), np.eye(4)
        pose[:3, 3] = x, y, size[2] / 2
        objects[each] = TrueObject(mesh, *surface(mesh, 1000), MeshCollider(mesh))
        poses[each] = pose
    return TrueScene(objects, poses, np.eye(4))


def test_a_standing_box_can_be_held():
    assert possible.best_quality(true_scene((STANDING, 0, 0)), 0, gripper()) == 1.0


def test_a_wide_slab_on_the_table_cannot_be_held():
    assert possible.best_quality(true_scene((SLAB, 0, 0)), 0, gripper()) == 0.0


def test_a_box_between_higher_walls_cannot_be_held():
    assert possible.best_quality(true_scene((STANDING, 0, 0), *WALLS), 0, gripper()) == 0.0


def test_pairs_of_a_ball_are_across_it_and_a_large_ball_has_none():
    rng = np.random.default_rng(0)
    pairs = possible.antipodal_pairs(ball(0.03), gripper(), rng)
    assert len(pairs) == possible.PAIRS
    np.testing.assert_allclose(np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1), 0.06, atol=2e-3)
    np.testing.assert_allclose(pairs.mean(axis=1), 0.0, atol=3e-3)  # its faces are flat
    assert not len(possible.antipodal_pairs(ball(0.2), gripper(), rng))
