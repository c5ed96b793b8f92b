"""Hands in Darboux frames of rendered shapes, and their collisions."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.geometry.pointcloud import Plane
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import are_rotations
from pipelines.grasping.peers.darboux import (
    candidate_hands,
    darboux_frames,
    outward_normals,
    over_table,
)
from pipelines.grasping.peers.hands import Hands, drawn_points, free_hands, hand_grasps, thinned
from tests.geometry.tabletops import Can
from tests.grasping.seen_regions import seen


def can():
    """Return the table's pose, the points of a can of radius 3 cm, and those of the scene."""
    pose, scene, _ = seen([Can(0.03, 0.12)])
    points = scene.xyz[(scene.depth > 0) & ~scene.stray]
    return pose, over_table(points, scene.plane), points


def a_hand(origin, depth=0.02):
    """One hand along z, closing along x."""
    rotation = np.array([[[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]])
    return Hands.equally_open(rotation, np.array([origin], float), np.array([depth]))


def test_hands_at_the_side_of_a_can_close_across_its_axis():
    pose, objects, _ = can()
    objects = thinned(objects)
    up = pose[:3, 2]
    height = (objects - pose[:3, 3]) @ up
    at = objects[(height > 0.04) & (height < 0.09)]
    frames = darboux_frames(at, objects, outward_normals(objects))
    assert are_rotations(frames)
    assert np.median(np.abs(frames[:, :, 2] @ up)) > 0.99
    assert np.median(np.abs(frames[:, :, 1] @ up)) < 0.1


def test_approaches_come_from_the_cameras_side():
    _, objects, points = can()
    hands = candidate_hands(thinned(objects), thinned(points), 200, np.random.default_rng(0))
    assert len(hands)
    toward = np.einsum("ni,ni->n", hands.rotation[:, :, 0], hands.origin)
    assert (toward > 0).mean() > 0.95


def test_a_hand_whose_finger_would_meet_the_cloud_is_not_free():
    grid = np.stack(np.meshgrid(*[np.arange(-0.01, 0.011, 0.005)] * 3), -1).reshape(-1, 3)
    wall = np.add(grid, [0.045, 0.0, 0.0])  # at a finger's place
    hand = a_hand([0.0, 0.0, 0.0])
    assert free_hands(hand, grid, grid).tolist() == [True]
    assert free_hands(hand, grid, np.concatenate([grid, wall])).tolist() == [False]


def test_a_hand_that_closes_on_nothing_is_left_out():
    far = np.full((30, 3), 1.0)
    assert free_hands(a_hand([0.0, 0.0, 0.0]), far, far).tolist() == [False]


def test_the_closing_region_is_seen_in_the_hands_frame():
    points = np.array([[0.03, 0, 0.01], [0.05, 0, 0.01], [0, 0.015, 0], [0, 0.03, 0], [0, 0, 0.03]])
    local = a_hand([0.0, 0.0, 0.0]).closing_region(0, points)
    assert_allclose(local, [[0.01, 0.03, 0.0], [0.0, 0.0, 0.015]])


@pytest.mark.parametrize(("opening", "opened"), [(0.08, 0.08), (0.2, 0.11)])
def test_a_grasp_has_its_finger_tips_where_the_hand_has_them_and_opens_as_wide(opening, opened):
    hand, gripper = a_hand([0.1, 0.2, 0.5]), load_gripper("rg2")  # which opens by 11 cm
    grasps = hand_grasps(replace(hand, opening=np.array([opening])), gripper)
    tips = grasps.translation + gripper.tip_reach * grasps.approach
    assert_allclose(tips, [[0.1, 0.2, 0.52]])
    assert_allclose(gripper.opening(grasps.width), opened)


@pytest.mark.parametrize("available", [5, 40])
def test_all_points_are_drawn_where_there_are_few(available):
    points = np.arange(3.0 * available).reshape(-1, 3)
    drawn = drawn_points(points, 20, np.random.default_rng(0))
    assert drawn.shape == (20, 3)
    assert len(np.unique(drawn, axis=0)) == min(available, 20)


def test_points_on_the_table_or_high_above_it_belong_to_no_object():
    table = Plane(np.array([0.0, 0.0, -1.0]), 1.0)
    points = np.array([[0, 0, 0.998], [0, 0, 0.9], [0, 0, 0.2]])
    assert_allclose(over_table(points, table), points[1:2])
    assert_allclose(over_table(points, None), points)
