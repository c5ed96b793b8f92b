"""Both antipodal scores on shapes where they are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry.transforms import (
    make_pose,
    random_rotation,
    rotate_vectors,
    transform_points,
)
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.antipodal import closing_region_score, contact_pair_score
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction
from tests.metrics.shapes import ball, box, gripper, random_grasps, surface

few = settings(max_examples=10, deadline=None)
seeds = st.integers(0, 2**32 - 1)
CENTERED = GraspPoses(np.eye(3), np.zeros(3), np.array(0.04))
ALONE = np.zeros((0, 3))  # points of other objects


def test_a_centred_grasp_of_a_box_scores_one_by_both_scores():
    mesh = box(0.2, 0.04, 0.2)
    points, normals = surface(mesh)
    assert contact_pair_score(close_fingers(mesh, CENTERED, 0.06)) == pytest.approx(1.0)
    assert closing_region_score(points, normals, CENTERED, gripper(), ALONE) == pytest.approx(1.0)


def test_a_tilted_grasp_scores_the_squared_cosine_by_both_scores():
    angle = 0.4
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    tilted = GraspPoses(turn, np.zeros(3), np.array(0.08))
    mesh = box(0.3, 0.04, 0.2)
    points, normals = surface(mesh)
    assert_allclose(contact_pair_score(close_fingers(mesh, tilted, 0.1)), np.cos(angle) ** 2)
    region = closing_region_score(points, normals, tilted, gripper(), ALONE)
    assert_allclose(region, np.cos(angle) ** 2, atol=1e-9)


def test_a_grasp_of_nothing_scores_zero():
    away = GraspPoses(np.eye(3), np.array([0.5, 0, 0]), np.array(0.04))
    points, normals = surface(ball(0.03))
    assert contact_pair_score(close_fingers(ball(0.03), away, 0.06)).tolist() == [0.0]
    assert closing_region_score(points, normals, away, gripper(), ALONE).tolist() == [0.0]


def test_another_object_between_the_fingers_scores_zero():
    points, normals = surface(box(0.2, 0.04, 0.2))
    foreign = np.array([[0.0, 0.021, 0.0]])
    assert closing_region_score(points, normals, CENTERED, gripper(), foreign).tolist() == [0.0]


@pytest.mark.parametrize(
    ("half", "counted", "left_out"), [(0.02, 0.0049, 0.0051), (0.006, 0.0039, 0.0041)]
)
def test_the_outer_5_mm_of_a_side_count_but_a_third_of_a_thin_object(half, counted, left_out):
    # On each side ten points at the outside with cosine 1, ten farther in with 0.5, then with 0.
    closing = np.repeat([half, half - counted, half - left_out], 10)
    points, normals = np.zeros((2, 60, 3))
    points[:, 1], normals[:, 1] = [*closing, *-closing], np.tile(np.repeat([1.0, 0.5, 0.0], 10), 2)
    score = closing_region_score(points, normals, CENTERED, gripper(), ALONE)
    assert score == pytest.approx(0.75**2)  # of the means of both sides


@pytest.mark.parametrize(("count", "score"), [(9, 0.0), (10, 1.0)])
def test_ten_points_between_the_fingers_are_a_surface(count, score):
    points, normals = np.zeros((2, count, 3))
    points[:, 1], normals[:, 1] = np.linspace(-0.02, 0.02, count), 1.0
    assert closing_region_score(points, normals, CENTERED, gripper(), ALONE) == score


def test_the_pair_score_is_bounded_by_the_smallest_friction():
    grasps = random_grasps(np.random.default_rng(1), 300, spread=0.02)
    contacts = close_fingers(ball(0.03), grasps, 0.1)
    mu = min_friction(contacts)
    held = np.isfinite(mu)
    assert held.sum() > 100
    assert (contact_pair_score(contacts)[held] >= 1.0 / (1.0 + mu[held] ** 2) - 1e-12).all()


@given(seeds)
@few
def test_the_region_score_does_not_depend_on_the_frame(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    grasps = random_grasps(rng, 10, spread=0.02)
    points, normals = surface(ball(0.03))
    here = closing_region_score(points, normals, grasps, gripper(), ALONE)
    there = closing_region_score(
        transform_points(T, points),
        rotate_vectors(T, normals),
        grasps.transformed(T),
        gripper(),
        ALONE,
    )
    assert_allclose(there, here, atol=1e-6)
