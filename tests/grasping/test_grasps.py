"""Grasp poses: the grasp frame, contacts and GraspNet's rows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.errors import ValueRangeError
from pipelines.geometry.transforms import make_pose, random_rotation, transform_points, unit
from pipelines.grasping.grasps import GraspPoses, from_graspnet, to_graspnet

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)


def random_grasps(rng, n=5):
    rotation = np.stack([random_rotation(rng) for _ in range(n)])
    return GraspPoses(rotation, rng.normal(size=(n, 3)), rng.uniform(0.01, 0.1, n))


@few
@given(seeds)
def test_contacts_and_approach_determine_the_grasp(seed):
    grasps = random_grasps(np.random.default_rng(seed))
    again = GraspPoses.from_contacts(grasps.contacts, grasps.approach)
    assert_allclose(again.rotation, grasps.rotation, atol=1e-9)
    assert_allclose(again.translation, grasps.translation, atol=1e-12)
    assert_allclose(again.width, grasps.width, atol=1e-12)


@few
@given(seeds)
def test_an_approach_partly_along_the_contact_line_is_made_perpendicular(seed):
    rng = np.random.default_rng(seed)
    contacts, approach = rng.normal(size=(4, 2, 3)), unit(rng.normal(size=(4, 3)))
    grasps = GraspPoses.from_contacts(contacts, approach)
    assert_allclose(np.einsum("ni,ni->n", grasps.approach, grasps.closing), 0.0, atol=1e-9)
    assert_allclose(np.linalg.det(grasps.rotation), 1.0)


def test_an_approach_along_the_contact_line_is_replaced_by_a_perpendicular_one():
    grasps = GraspPoses.from_contacts([[[0, 0, 0], [0, 0, 0.05]]], [[0, 0, 1.0]])
    assert_allclose(grasps.approach[0] @ grasps.closing[0], 0.0, atol=1e-12)
    assert_allclose(np.linalg.det(grasps.rotation), 1.0)


@few
@given(seeds)
def test_moving_grasps_moves_their_contacts(seed):
    rng = np.random.default_rng(seed)
    grasps, T = random_grasps(rng), make_pose(random_rotation(rng), rng.normal(size=3))
    moved = grasps.transformed(T)
    assert_allclose(moved.contacts, transform_points(T, grasps.contacts), atol=1e-9)


@few
@given(seeds)
def test_graspnet_rows_reproduce_the_contacts(seed):
    grasps = random_grasps(np.random.default_rng(seed))
    rows = to_graspnet(grasps, np.ones(5), tip_reach=0.005, depth=0.03)
    assert rows.shape == (5, 17)
    again = from_graspnet(rows, tip_reach=0.005)
    assert_allclose(again.contacts, grasps.contacts, atol=1e-9)


def test_graspnets_finger_tips_lie_depth_ahead_of_its_origin():
    grasp = GraspPoses(np.eye(3)[None], np.zeros((1, 3)), np.array([0.04]))
    row = to_graspnet(grasp, [1.0], tip_reach=0.0, depth=0.02)[0]
    assert_allclose(row[13:16] + row[3] * row[4:13].reshape(3, 3)[:, 0], [0, 0, 0], atol=1e-12)


def test_a_left_handed_rotation_is_refused():
    with pytest.raises(ValueRangeError, match="rotation"):
        GraspPoses(np.diag([1.0, -1.0, 1.0])[None], np.zeros((1, 3)), np.ones(1))


def test_concatenation_keeps_order_and_accepts_no_grasps():
    grasps = random_grasps(np.random.default_rng(0))
    both = GraspPoses.concatenate([GraspPoses.empty(), grasps, grasps[:2]])
    assert len(both) == 7
    assert_allclose(both.width[5:], grasps.width[:2])
    assert len(GraspPoses.concatenate([])) == 0


def test_approach_angles_turn_a_grasp_about_its_contact_line():
    grasps, angles = random_grasps(np.random.default_rng(2)), np.array([0.0, 0.7, 2.9, -1.1, 6.0])
    turned = grasps.at_approach_angles(np.arange(5), angles)
    assert_allclose(turned.contacts, grasps.contacts, atol=1e-12)
    assert_allclose((turned.approach * grasps.approach).sum(1), np.cos(angles), atol=1e-12)
    assert_allclose((turned.approach * grasps.binormal).sum(1), np.sin(angles), atol=1e-12)
    assert_allclose(turned.binormal, np.cross(turned.approach, turned.closing), atol=1e-12)
