"""Non-maximum suppression equals checking every grasp and comparing every pair."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import RankingConfig
from pipelines.geometry.transforms import random_rotation, rotation_about
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranking.ranking import are_near, non_maximum_suppression

CONFIG = RankingConfig()
DISTANCE, ANGLE = CONFIG.nms_distance, CONFIG.nms_angle
seeds = st.integers(0, 2**31)


def alike_grasps(rng, count):
    """Grasps around a few places and rotations, some with their fingers swapped."""
    places, turns = rng.normal(0, 0.03, (3, 3)), [random_rotation(rng) for _ in range(3)]
    rotation = np.stack(
        [
            turns[rng.integers(3)] @ rotation_about(rng.normal(size=3), rng.normal(0, 0.4))
            for _ in range(count)
        ]
    ).reshape(-1, 3, 3)
    rotation[::3] *= [1.0, -1.0, -1.0]
    translation = places[rng.integers(3, size=count)] + rng.normal(0, 0.01, (count, 3))
    return GraspPoses(rotation, translation, rng.uniform(0.01, 0.1, count))


def angle_between(one, other):
    """Return the smaller rotation angle of both ways to hold a symmetric gripper."""
    angles = []
    for swap in (np.eye(3), np.diag([1.0, -1.0, -1.0])):
        turn = one @ (other @ swap).T
        sine = 0.5 * np.linalg.norm(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        angles.append(np.arctan2(sine, (np.trace(turn) - 1.0) / 2.0))
    return min(angles)


def naive_suppression(grasps, sound):
    kept = []
    for index in np.flatnonzero(sound):
        for better in kept:
            away = np.linalg.norm(grasps.translation[index] - grasps.translation[better])
            turned = angle_between(grasps.rotation[index], grasps.rotation[better])
            if away < DISTANCE and turned < ANGLE:
                break
        else:
            kept.append(index)
    return kept


@given(seeds, st.integers(1, 40))
@settings(max_examples=40, deadline=None)
def test_the_kept_grasps_equal_those_of_a_loop_over_all_sound_grasps(seed, count):
    rng = np.random.default_rng(seed)
    grasps, sound = alike_grasps(rng, count), rng.random(count) < 0.6
    checked = []

    def is_sound(some):
        places = [
            np.flatnonzero((grasps.translation == t).all(axis=1))[0] for t in some.translation
        ]
        checked.extend(places)
        return sound[places]

    assert non_maximum_suppression(grasps, DISTANCE, ANGLE, is_sound).tolist() == naive_suppression(
        grasps, sound
    )
    assert len(checked) == len(set(checked))  # none is checked twice


def test_no_grasps_are_kept_of_none():
    assert (
        len(
            non_maximum_suppression(
                GraspPoses.empty(), DISTANCE, ANGLE, lambda some: np.ones(len(some), bool)
            )
        )
        == 0
    )


def test_few_grasps_are_checked():
    grasps = GraspPoses(np.tile(np.eye(3), (50, 1, 1)), np.zeros((50, 3)), np.full(50, 0.05))
    checked = []

    def is_sound(some):
        checked.append(len(some))
        return np.ones(len(some), bool)

    assert non_maximum_suppression(grasps, DISTANCE, ANGLE, is_sound).tolist() == [0]
    assert checked == [1]


def test_swapped_fingers_are_the_same_grasp_and_a_turn_of_the_angle_is_another():
    swapped = np.diag([1.0, -1.0, -1.0])
    turned = rotation_about([0.0, 1.0, 0.0], ANGLE)
    grasps = GraspPoses(np.stack([np.eye(3), swapped, turned]), np.zeros((3, 3)), np.full(3, 0.05))
    near = are_near(grasps, DISTANCE, ANGLE)
    assert near.tolist() == [[True, True, False], [True, True, False], [False, False, True]]
    apart = GraspPoses(grasps.rotation, np.diag([0.0, DISTANCE, 1.0]), grasps.width)
    assert (are_near(apart, DISTANCE, ANGLE) == np.eye(3, dtype=bool)).all()
