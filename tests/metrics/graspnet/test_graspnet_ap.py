"""Suppression, ranking and accuracy of GraspNet's protocol."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.geometry.transforms import (
    make_pose,
    random_rotation,
    rotation_about,
    transform_points,
)
from pipelines.metrics.graspnet import graspnet_ap
from pipelines.metrics.graspnet.graspnet_ap import (
    AP_FRICTIONS,
    PER_OBJECT,
    RANKS,
    accuracy,
    ranked,
    suppress,
)

few = settings(max_examples=20, deadline=None)
seeds = st.integers(0, 2**32 - 1)
X = np.array([1.0, 0.0, 0.0])


def naive_suppress(confidence, rotation, translation):
    kept: list[int] = []
    for i in sorted(range(len(confidence)), key=lambda i: -confidence[i]):
        for k in kept:
            gap = np.linalg.norm(translation[i] - translation[k])
            cosine = (np.trace(rotation[i] @ rotation[k].T) - 1.0) / 2.0
            if gap < 0.03 and np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 30.0:
                break
        else:
            kept.append(i)
    return kept


def crowd(rng, count=80):
    """Grasps in a crowd of 8 cm whose approaches differ by up to a radian or so."""
    turns = [rotation_about(random_rotation(rng)[0], a) for a in rng.normal(0.0, 0.5, count)]
    return rng.random(count), np.stack(turns), rng.uniform(-0.04, 0.04, (count, 3))


@given(seeds, st.sampled_from([7, 256]))
@few
def test_suppression_is_greedy_for_any_block_size(seed, at_a_time):
    grasps = crowd(np.random.default_rng(seed))
    before = graspnet_ap.AT_A_TIME
    try:
        graspnet_ap.AT_A_TIME = at_a_time
        assert suppress(*grasps).tolist() == naive_suppress(*grasps)
    finally:
        graspnet_ap.AT_A_TIME = before


@given(seeds)
@few
def test_suppression_does_not_depend_on_the_frame(seed):
    rng = np.random.default_rng(seed)
    confidence, rotation, translation = crowd(rng)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    there = suppress(confidence, T[:3, :3] @ rotation, transform_points(T, translation))
    assert_array_equal(there, suppress(confidence, rotation, translation))


@pytest.mark.parametrize(("gap", "angle", "left"), [(0.0299, 0.0, 1), (0.03, 0.0, 2)])
def test_both_limits_are_strict(gap, angle, left):
    rotation = np.stack([np.eye(3), rotation_about(X, angle)])
    assert len(suppress([0.9, 0.8], rotation, np.array([[0.0, 0, 0], [0, 0, gap]]))) == left


@pytest.mark.parametrize(("degrees", "left"), [(29.9, 1), (30.1, 2), (180.0, 2)])
def test_a_hand_turned_by_more_than_30_degrees_is_another_grasp(degrees, left):
    rotation = np.stack([np.eye(3), rotation_about(X, np.radians(degrees))])
    assert len(suppress([0.9, 0.8], rotation, np.zeros((2, 3)))) == left


def test_a_suppressed_grasp_suppresses_nothing():
    along = np.array([[0.0, 0, 0], [0, 0, 0.02], [0, 0, 0.04]])
    assert suppress([0.9, 0.8, 0.7], np.tile(np.eye(3), (3, 1, 1)), along).tolist() == [0, 2]


def test_among_ties_the_first_of_the_file_stays_and_leads():
    same = np.tile(np.eye(3), (4, 1, 1))
    apart = np.array([[0.0, 0, 0], [0, 0, 0.01], [0, 0, 1], [0, 0, 1.01]])
    assert suppress(np.full(4, 0.5), same, apart).tolist() == [0, 2]
    assert ranked(np.full(3, 0.5), np.array([1, 0, 1])).tolist() == [0, 1, 2]


@pytest.mark.parametrize("seed", range(5))
def test_the_ranking_equals_one_grasp_after_the_other(seed):
    rng = np.random.default_rng(seed)
    confidence = np.sort(rng.integers(1, 40, 150))[::-1] / 40.0  # with many ties
    owner = rng.integers(0, 8, 150)
    found = []
    for index in range(150):
        if sum(owner[found] == owner[index]) < PER_OBJECT:
            found.append(index)
    least = confidence[found[RANKS - 1]]
    expected = [index for index in found if confidence[index] >= least]
    assert ranked(confidence, owner).tolist() == expected


def test_ten_grasps_of_each_object_are_judged():
    confidence, owner = np.linspace(1.0, 0.5, 30), np.arange(30) % 2
    assert ranked(confidence, owner).tolist() == list(range(20))


def test_grasps_below_the_fiftieth_are_not_judged_but_ties_with_it_are():
    confidence, owner = np.linspace(1.0, 0.5, 70), np.arange(70) % 7
    assert len(ranked(confidence, owner)) == RANKS
    confidence[45:55] = confidence[49]
    assert len(ranked(confidence, owner)) == 55


def test_no_grasps_give_no_ranking():
    assert len(suppress([], np.zeros((0, 3, 3)), np.zeros((0, 3)))) == 0
    assert len(ranked(np.zeros(0), np.zeros(0, np.int64))) == 0
    assert accuracy([]).tolist() == np.zeros((RANKS, len(AP_FRICTIONS))).tolist()


def test_the_accuracy_of_a_known_ranking():
    found = accuracy([0.4, -1.0, 0.2])
    assert_allclose(found[:4, 0], [0, 0, 1 / 3, 1 / 4])  # at 0.2
    assert_allclose(found[:4, 1], [1, 1 / 2, 2 / 3, 2 / 4])  # at 0.4
    assert found[49, 5] == 2 / 50


def test_perfect_grasps_of_many_objects_have_ap_one():
    assert accuracy(np.full(60, 0.2)).min() == 1.0


@given(seeds)
@few
def test_ap_grows_with_friction_and_better_grasps_never_lower_it(seed):
    rng = np.random.default_rng(seed)
    friction = rng.choice([*AP_FRICTIONS, -1.0], rng.integers(0, 60))
    found = accuracy(friction)
    assert (np.diff(found, axis=1) >= 0.0).all()
    better = np.where(rng.random(len(friction)) < 0.3, 0.2, friction)
    assert (accuracy(better) >= found).all()
