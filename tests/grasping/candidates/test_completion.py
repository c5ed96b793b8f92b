"""The unseen sides of regions, and hands that keep off those of their neighbours."""

from dataclasses import replace

import numpy as np

from pipelines.configs import SelectionConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.candidates.completion import Completion, completions, hidden_points
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.region_grasping import plan_region
from tests.geometry.tabletops import CAMERA, Can, looking_at_table, render

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")
POSE = looking_at_table(elevation=0.6)
TARGET = Can(0.03, 0.06)
BEFORE = Can(0.03, 0.1, (0.02, -0.072, 0.0))  # nearer to the camera, its far side unseen


def seen(*cans):
    """A scene of cans, their regions and what is known of their symmetry."""
    depth, index = render(cans, POSE)
    scene = SceneCloud(depth, CAMERA, Plane(POSE[:3, 2], float(-POSE[:3, 2] @ POSE[:3, 3])))
    regions = [RegionCloud.from_mask(index == number, scene) for number in range(len(cans))]
    axes = [RotationSymmetry(POSE[:3, 2], transform_points(POSE, can.at)) for can in cans]
    return scene, regions, [SymmetrySlots.from_symmetries([axis]) for axis in axes]


def wall(can):
    """Points all around a can's side, camera frame."""
    angle, height = np.meshgrid(np.arange(0, 2 * np.pi, 0.05), np.arange(0, can.height, 0.002))
    side = np.stack([can.radius * np.cos(angle), can.radius * np.sin(angle), height], -1)
    return transform_points(POSE, side.reshape(-1, 3) + np.array(can.at))


def met(found, points):
    """How many of `points` lie in the bodies of each hand."""
    grasps = found.grasps
    local = np.einsum("kpi,kij->kpj", points - grasps.translation[:, None], grasps.rotation)
    boxes = GRIPPER.boxes(grasps.width)[:, :, :, None]
    inside = (local[:, None] > boxes[:, :, 0]) & (local[:, None] < boxes[:, :, 1])
    return inside.all(axis=-1).any(axis=1).sum(axis=1)


def planned(scene, region, slots, completion):
    affordance = np.ones(len(region))
    return plan_region(region, scene, slots, affordance, GRIPPER, CONFIG, None, completion)


def test_symmetries_fill_in_the_unseen_side():
    scene, [region], [slots] = seen(TARGET)
    hidden = hidden_points(region, slots.to_symmetries(), scene, CONFIG)
    local = transform_points(invert(POSE), hidden)
    side = local[(local[:, 2] > 0.005) & (local[:, 2] < 0.055)]
    np.testing.assert_allclose(np.linalg.norm(side[:, :2], axis=1), TARGET.radius, atol=0.002)
    assert (side[:, 1] > 0.02).any()  # the far side
    assert len(hidden_points(region, [], scene, CONFIG)) == 0


def test_a_region_is_completed_by_its_own_symmetries_and_its_neighbours_by_theirs():
    scene, regions, slots = seen(TARGET, BEFORE)
    slots = [replace(slots[0], existence=0.4 * slots[0].existence), slots[1]]
    first, second = completions(regions, scene, slots, CONFIG)
    assert len(first.own) == 0  # not trusted enough for its own hands
    for found, region, each in ((second.own, 1, slots[1]), (second.others, 0, slots[0])):
        expected = hidden_points(regions[region], each.to_symmetries(0.3), scene, CONFIG)
        assert len(expected) > 0  # the first's: enough for its neighbour's to keep off
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(first.others, second.own)


def test_hands_keep_off_the_unseen_side_of_a_neighbour():
    scene, regions, slots = seen(TARGET, BEFORE)
    both = completions(regions, scene, slots, CONFIG)[0]
    alone = Completion(both.own, np.zeros((0, 3)))
    plans = [planned(scene, regions[0], slots[0], known) for known in (alone, both)]
    hits = [met(plan, wall(BEFORE)) for plan in plans]
    assert hits[0].max() > 100  # what is seen does not tell
    assert len(plans[1]) > 0
    assert hits[1].max() <= CONFIG.max_points_inside


def test_a_region_that_neighbours_would_leave_no_grasp_is_planned_without_them():
    scene, regions, slots = seen(TARGET, BEFORE)
    own = completions(regions, scene, slots, CONFIG)[0].own
    rng = np.random.default_rng(0)
    up = rotate_vectors(POSE, [0.0, 0.0, 1.0])
    everywhere = regions[0].middle + 0.05 * up + rng.uniform(-0.1, 0.1, (20_000, 3))
    found, without = (
        planned(scene, regions[0], slots[0], Completion(own, others))
        for others in (everywhere, np.zeros((0, 3)))
    )
    assert len(without) > 0
    np.testing.assert_array_equal(found.grasps.translation, without.grasps.translation)
