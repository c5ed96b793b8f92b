"""Collision of the open gripper with meshes and the table, against positions that are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.mesh_collision import MeshCollider, hits_table
from tests.metrics.shapes import ball, box, gripper, moved, random_grasps, surface

few = settings(max_examples=8, deadline=None)
seeds = st.integers(0, 2**32 - 1)


def grasp_at(x: float, y: float, z: float, width: float = 0.04) -> GraspPoses:
    return GraspPoses(np.eye(3), np.array([x, y, z]), np.array(width))


def hits(mesh, grasp: GraspPoses) -> bool:
    return bool(MeshCollider(mesh).hits(grasp, gripper())[0])


def test_open_fingers_do_not_touch_the_box_between_them():
    assert not hits(box(0.06, 0.04, 0.1), grasp_at(0, 0, 0))


@pytest.mark.parametrize(("shift", "expected"), [(0.0099, False), (0.0101, True)])
def test_a_finger_hits_the_box_once_its_clearance_is_used_up(shift, expected):
    assert hits(box(0.04, 0.04, 0.1), grasp_at(0, shift, 0)) is expected


@pytest.mark.parametrize(("depth", "expected"), [(0.0249, False), (0.0251, True)])
def test_the_palm_hits_the_box_once_the_fingers_are_too_deep(depth, expected):
    # The palm's front is 45 mm behind the contacts, the box reaches 20 mm towards it.
    assert hits(box(0.04, 0.04, 0.1), grasp_at(depth, 0, 0)) is expected


def test_a_gripper_inside_a_solid_is_in_collision():
    assert hits(box(1.0, 1.0, 1.0), grasp_at(0.1, 0.1, 0.1))


def test_a_gripper_far_away_is_free():
    assert not hits(ball(0.03), grasp_at(0.5, 0, 0))


@given(seeds)
@few
def test_a_surface_point_inside_a_box_means_collision(seed):
    rng = np.random.default_rng(seed)
    mesh, grasps = ball(0.03), random_grasps(rng, 20, spread=0.06)
    points, _ = surface(mesh)
    collider = MeshCollider(mesh).hits(grasps, gripper())
    for i, boxes in enumerate(gripper().boxes(grasps.width)):
        local = (points - grasps.translation[i]) @ grasps.rotation[i]
        inside = ((local[:, None] > boxes[:, 0]) & (local[:, None] < boxes[:, 1])).all(-1)
        assert collider[i] or not inside.any()


@given(seeds)
@few
def test_collisions_do_not_depend_on_the_frame(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    mesh, grasps = box(0.06, 0.04, 0.1), random_grasps(rng, 20, spread=0.06)
    here = MeshCollider(mesh).hits(grasps, gripper())
    there = MeshCollider(moved(mesh, T)).hits(grasps.transformed(T), gripper())
    assert (here == there).mean() >= 0.95  # a touch within rounding may differ


@pytest.mark.parametrize(("height", "expected"), [(0.0051, False), (0.0049, True)])
def test_finger_tips_meet_the_table_within_their_reach(height, expected):
    down = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # approach along -z
    grasp = GraspPoses(down, np.array([0.3, 0.2, height]), np.array(0.04))
    assert hits_table(grasp, gripper(), np.eye(4)).tolist() == [expected]


def test_the_table_is_at_the_place_of_its_transform():
    grasp = grasp_at(0, 0, 0.5)
    lowered = make_pose(np.eye(3), np.array([0, 0, -1.0]))
    assert hits_table(grasp, gripper(), np.eye(4)).tolist() == [False]
    assert hits_table(grasp, gripper(), lowered).tolist() == [True]
