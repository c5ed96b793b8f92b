"""The way in: what any pose along it meets, the sweep meets."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import SelectionConfig
from pipelines.geometry.transforms import random_rotation
from pipelines.grasp_files.gripper_files import load_gripper, preset_names
from pipelines.grasping.feasibility.approach_path import approach_is_free
from pipelines.grasping.feasibility.collision import Obstacles, meets
from pipelines.grasping.grasps import Grasps

CONFIG = SelectionConfig(max_points_inside=0)
NOTHING = Obstacles(np.zeros((0, 3)), np.zeros(0, np.int64))
STEPS = np.linspace(0.0, CONFIG.approach_distance, 26)


def obstacle(*points):
    return Obstacles(np.array(points, np.float64), np.ones(len(points), np.int64))


def free(hands, near, scene=NOTHING, gripper=None, config=CONFIG):
    return approach_is_free(hands, gripper or load_gripper("rg2"), near, scene, config)


@given(st.integers(0, 2**31), st.sampled_from(sorted(preset_names())))
@settings(max_examples=40, deadline=None)
def test_a_way_is_free_if_no_pose_along_it_meets_anything(seed, name):
    rng, gripper = np.random.default_rng(seed), load_gripper(name)
    width = rng.uniform(0.01, gripper.max_width, 6)
    rotation = np.stack([random_rotation(rng) for _ in range(6)])
    hands = Grasps(rotation, rng.normal(0, 0.02, (6, 3)), width)
    scene = Obstacles(rng.uniform(-0.25, 0.25, (30, 3)), np.ones(30, np.int64))
    met = np.zeros(6, bool)
    for step in STEPS:
        pose = replace(hands, translation=hands.translation - step * hands.approach)
        met |= meets(pose, gripper, scene, CONFIG.body_margin, 0)[0]
    found = free(hands, scene, gripper=gripper)
    assert not found[met].any()
    # Nothing else is in the way: one way is free if points come no nearer than between steps.
    slim = replace(CONFIG, body_margin=CONFIG.body_margin - 0.0011, approach_distance=0.098)
    assert free(hands, scene, gripper=gripper, config=slim)[~met].all()


HAND = Grasps(np.eye(3)[None], np.zeros((1, 3)), np.array([0.05]))  # approaches along x


@pytest.mark.parametrize("place", ["near", "scene"])
@pytest.mark.parametrize(("behind", "expected"), [(0.03, False), (0.11, True)])
def test_what_stands_behind_the_hand_counts_as_far_as_it_comes_from(place, behind, expected):
    gripper = load_gripper("rg2")
    back = gripper.boxes(0.05)[2, 0, 0]
    clouds = {"near": NOTHING, "scene": NOTHING} | {place: obstacle([back - behind, 0, 0])}
    assert free(HAND, clouds["near"], clouds["scene"]).tolist() == [expected]
    assert not meets(HAND, gripper, obstacle([back - behind, 0, 0]), 0.001, 0)[0].any()


def test_without_a_distance_no_way_is_looked_at():
    config = replace(CONFIG, approach_distance=0.0)
    assert free(HAND, obstacle([-0.12, 0, 0]), config=config).tolist() == [True]


def test_fingers_that_stick_out_of_the_palm_sweep_their_own_height():
    slim = replace(load_gripper("rg2"), palm_height=0.004)
    point = obstacle([-0.11, 0.035, 0.009])  # behind a finger, above the palm
    assert free(HAND, point, gripper=slim).tolist() == [False]
