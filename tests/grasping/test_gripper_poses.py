"""Grasps as poses of a gripper base."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry.transforms import rotation_about
from pipelines.grasping.grasps import (
    CLOSING_ALONG_X,
    CLOSING_ALONG_Y,
    from_graspnet,
    gripper_poses,
    to_graspnet,
)
from tests.grasping.test_grasps import random_grasps

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)


@few
@given(seeds, st.floats(0, 0.3))
def test_both_conventions_are_rotations_whose_z_is_the_approach(seed, behind):
    grasps = random_grasps(np.random.default_rng(seed))
    for axes, closing in ((CLOSING_ALONG_X, 0), (CLOSING_ALONG_Y, 1)):
        poses = gripper_poses(grasps, behind, axes)
        assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)
        assert_allclose(poses[:, :3, 2], grasps.approach)
        assert_allclose(poses[:, :3, closing], grasps.closing)
        assert_allclose(poses[:, :3, 3] + behind * poses[:, :3, 2], grasps.translation, atol=1e-12)


def test_the_conventions_are_a_quarter_turn_apart():
    quarter = rotation_about([0, 0, 1], np.pi / 2)
    assert_allclose(CLOSING_ALONG_Y @ quarter, CLOSING_ALONG_X, atol=1e-12)


@few
@given(seeds)
def test_graspnets_rows_and_grippers_give_the_same_contacts(seed):
    grasps = random_grasps(np.random.default_rng(seed))
    back = from_graspnet(to_graspnet(grasps, 1.0, tip_reach=0.004, depth=0.02), tip_reach=0.004)
    poses = gripper_poses(back, 0.1034, CLOSING_ALONG_X)
    middle = poses[:, :3, 3] + 0.1034 * poses[:, :3, 2]
    half = 0.5 * back.width[:, None] * poses[:, :3, 0]
    assert_allclose(np.stack([middle - half, middle + half], 1), grasps.contacts, atol=1e-9)
