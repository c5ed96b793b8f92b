"""The approach path of a grasp: the sweep meets every obstacle that a pose along it meets."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import FeasibilityConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import random_rotation, transform_points
from pipelines.grasp_files.gripper_files import load_gripper, preset_names
from pipelines.grasping.feasibility.collision import bodies_meet, lowest_height
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.feasibility.surroundings import Surroundings
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.obstacles import Obstacles
from pipelines.grasping.scene import SceneCloud
from tests.geometry.tabletops import CAMERA, Box, looking_at_table
from tests.grasping.seen_regions import seen

CONFIG = FeasibilityConfig(max_points_inside=0)
NOTHING = Obstacles(np.zeros((0, 3)), np.zeros(0, np.int64))
STEPS = np.linspace(0.0, CONFIG.approach_distance, 26)
ANY_POINT = replace(CONFIG, max_points_inside=0)


def obstacle(*points):
    return Obstacles(np.array(points, np.float64), np.ones(len(points), np.int64))


def free(grasps, near, far=NOTHING, gripper=None, config=CONFIG):
    """Return whether paths are free of the points `near` a region and `far` from it."""
    scene = SceneCloud(np.zeros((240, 320)), CAMERA)
    scene.__dict__["coarse_obstacles"] = far
    around = Surroundings(near, NOTHING, np.zeros(3), 1.0, None)
    checks = Feasibility(gripper or load_gripper("rg2"), scene, around, None, config)
    return checks.has_free_path(grasps)


@given(st.integers(0, 2**31), st.sampled_from(sorted(preset_names())))
@settings(max_examples=40, deadline=None)
def test_a_path_is_free_if_no_pose_along_it_meets_an_obstacle(seed, name):
    rng, gripper = np.random.default_rng(seed), load_gripper(name)
    width = rng.uniform(0.01, gripper.max_width, 6)
    rotation = np.stack([random_rotation(rng) for _ in range(6)])
    grasps = GraspPoses(rotation, rng.normal(0, 0.02, (6, 3)), width)
    scene = Obstacles(rng.uniform(-0.25, 0.25, (30, 3)), np.ones(30, np.int64))
    met = np.zeros(6, bool)
    for step in STEPS:
        pose = replace(grasps, translation=grasps.translation - step * grasps.approach)
        met |= bodies_meet(pose, gripper, scene, ANY_POINT)[0]
    assert not free(grasps, scene, gripper=gripper)[met].any()
    # A path is free if all points keep clear by more than the gap between two steps.
    slim = replace(CONFIG, body_margin=CONFIG.body_margin - 0.0011, approach_distance=0.098)
    assert free(grasps, scene, gripper=gripper, config=slim)[~met].all()


ALONG_X = GraspPoses(np.eye(3)[None], np.zeros((1, 3)), np.array([0.05]))  # approaches along x


@pytest.mark.parametrize("place", ["near", "far"])
@pytest.mark.parametrize(("behind", "expected"), [(0.03, False), (0.11, True)])
def test_an_obstacle_behind_the_gripper_counts_up_to_the_start_of_the_path(place, behind, expected):
    gripper = load_gripper("rg2")
    back = gripper.boxes(0.05)[2, 0, 0]
    clouds = {"near": NOTHING, "far": NOTHING} | {place: obstacle([back - behind, 0, 0])}
    assert free(ALONG_X, clouds["near"], clouds["far"]).tolist() == [expected]
    point = obstacle([back - behind, 0, 0])
    assert not bodies_meet(ALONG_X, gripper, point, ANY_POINT)[0].any()


def test_without_an_approach_distance_every_path_is_free():
    config = replace(CONFIG, approach_distance=0.0)
    assert free(ALONG_X, obstacle([-0.12, 0, 0]), config=config).tolist() == [True]


def test_fingers_that_stick_out_of_the_palm_sweep_their_own_height():
    slim = replace(load_gripper("rg2"), palm_height=0.004)
    point = obstacle([-0.11, 0.035, 0.009])  # behind a finger, above the palm
    assert free(ALONG_X, point, gripper=slim).tolist() == [False]


def test_a_low_obstacle_within_the_margin_below_a_finger_is_met():
    gripper, tips = load_gripper("rg2"), CONFIG.min_table_distance + 0.0001
    pose, scene, region = seen([Box((0.03, 0.03, 0.03))], looking_at_table())
    checks = Feasibility.at(region, scene, gripper, CONFIG, 0.05)
    height = tips + gripper.tip_reach
    contacts = transform_points(pose, [[-0.015, 0.0, height], [0.015, 0.0, height]])
    grasps = GraspPoses.from_contacts(contacts[None], -pose[None, :3, 2])
    assert checks.allows(grasps).item()
    beneath = 0.015 + gripper.clearance + gripper.finger_thickness / 2
    for below in (0.0005, 0.0015):
        point = transform_points(pose, [[beneath, 0.0, tips - below]])
        assert checks.with_unseen(point).allows(grasps).item() == (below > CONFIG.body_margin)


@pytest.mark.parametrize(("height", "expected"), [(0.018, False), (0.020, True)])
def test_a_gripper_that_comes_from_below_keeps_off_the_table_on_its_whole_path(height, expected):
    # The path of 10 cm rises by 10 cm x sin 0.15 = 15 mm; 4 mm stay free at its start.
    gripper, table = load_gripper("rg2"), Plane(np.array([0.0, -1.0, 0.0]), 0.1)
    approach = np.array([0.0, -np.sin(0.15), np.cos(0.15)])
    contacts = np.array([[-0.02, 0.0, 0.5], [0.02, 0.0, 0.5]])
    grasps = GraspPoses.from_contacts(contacts[None], approach[None])
    up = (height - lowest_height(grasps, gripper, table)) * table.normal
    raised = replace(grasps, translation=grasps.translation + up)
    around = Surroundings(NOTHING, NOTHING, np.zeros(3), 1.0, None)
    checks = Feasibility(
        gripper, SceneCloud(np.zeros((240, 320)), CAMERA, table), around, None, CONFIG
    )
    assert checks.allows(raised).item() is expected


@pytest.mark.parametrize("palm_width", [0.075, 0.5])
def test_a_wide_palm_meets_obstacles_far_from_the_region(palm_width):
    gripper = replace(load_gripper("rg2"), palm_width=palm_width)
    pillar = Box((0.03, 0.3, 0.25), (0.24, 0.0, 0.0))
    pose, scene, region = seen([Box((0.03, 0.03, 0.12)), pillar], looking_at_table())
    config = FeasibilityConfig(approach_distance=0.0)
    checks = Feasibility.at(region, scene, gripper, config, 0.05)
    contacts = transform_points(pose, [[-0.015, 0.0, 0.11], [0.015, 0.0, 0.11]])
    grasps = GraspPoses.from_contacts(contacts[None], -pose[None, :3, 2])
    assert checks.allows(grasps).item() == (palm_width < 0.5)
