"""Collision of GraspNet's box gripper with an object, against the peer's 6,000 verdicts."""

import numpy as np
import pytest

from pipelines.dataset.meshes import read_mesh
from pipelines.grasping.grasps import GraspPoses, from_graspnet
from pipelines.metrics.graspnet import box_collision
from pipelines.metrics.graspnet.box_collision import (
    cloud_collision,
    exact_collision,
    meets_points,
    voxel_means,
)
from pipelines.storage.array_files import read_npy, read_npz
from tests.metrics.shapes import random_grasps


@pytest.mark.parametrize("kind", ["antipodal", "label"])
@pytest.mark.parametrize("shape", ["box", "cylinder", "sphere"])
def test_the_cloud_agrees_with_the_peers_random_one(shared, shape, kind):
    rows = read_npy(shared / "oracle" / f"{shape}_{kind}.npy")
    peer = read_npz(shared / "oracle" / f"{shape}_{kind}.eval.npz")
    mesh = read_mesh(shared / "oracle" / f"{shape}.obj")
    collision, empty = cloud_collision(mesh, from_graspnet(rows), rows[:, 3])
    assert (collision == peer["collision"]).mean() > 0.99
    assert (empty == peer["empty"]).mean() > 0.99


def test_triangles_find_all_collisions_of_the_cloud_and_more(shared):
    rows = read_npy(shared / "oracle" / "box_label.npy")[:300]
    mesh = read_mesh(shared / "oracle" / "box.obj")
    exact = exact_collision(mesh, from_graspnet(rows), rows[:, 3])[0]
    cloud, empty = cloud_collision(mesh, from_graspnet(rows), rows[:, 3])
    assert exact[cloud & ~empty].all()
    assert 0 < (cloud & ~empty).sum() < exact.sum()


# Points in millimetres along approach, closing and binormal; the tips are at 0, 6 cm apart. Fingers
# reach from -40 to 0, 1 cm thick and 2 cm high; behind them is a slab of 1 cm, as wide as both.
@pytest.mark.parametrize(
    ("point", "hit", "inner"),
    [
        ((-0.5, 30.5, 0), True, 0),
        ((-0.5, -39.5, 9.5), True, 0),
        ((-0.5, 40.5, 0), False, 0),
        ((-0.5, 35, 10.5), False, 0),
        ((0.5, 35, 0), False, 0),
        ((-0.5, 29.5, -9.5), False, 1),
        ((-39.5, 0, 0), False, 1),
        ((-40.5, 0, 0), True, 0),
        ((-49.5, -39.5, 9.5), True, 0),
        ((-50.5, 0, 0), False, 0),
        ((-45, 40.5, 0), False, 0),
    ],
)
def test_a_point_just_inside_a_box_of_the_hand_is_met_and_one_just_outside_is_not(
    point, hit, inner
):
    hand = GraspPoses(np.eye(3), np.zeros(3), np.array(0.06))
    found = meets_points(np.array([point]) / 1000.0, hand, np.array([0.02]))
    assert [each.tolist() for each in found] == [[hit], [inner]]


def test_the_number_of_pairs_in_a_block_does_not_change_verdicts(monkeypatch):
    rng = np.random.default_rng(0)
    points, depth = rng.normal(size=(500, 3)) * 0.03, np.full(40, 0.02)
    grasps = random_grasps(rng, 40, spread=0.08)
    whole = meets_points(points, grasps, depth)
    monkeypatch.setattr(box_collision, "AT_A_TIME", 1700)  # three grasps
    parts = meets_points(points, grasps, depth)
    assert 0 < whole[0].sum() < 40
    for ours, theirs in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_voxels_hold_the_means_of_their_points():
    points = np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.02, 0.0, 0.0]])
    means = voxel_means(points)
    assert sorted(means[:, 0].round(6)) == [0.0005, 0.02]
