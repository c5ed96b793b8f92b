"""The unseen sides of regions, and grasps that keep clear of their neighbours' unseen sides."""

from dataclasses import replace

import numpy as np

from pipelines.configs import SelectionConfig
from pipelines.geometry.symmetry import RotationSymmetry
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.passes import RegionModel
from pipelines.grasping.planner import RegionPlanner
from pipelines.grasping.scene import RegionCloud
from pipelines.grasping.symmetries.completion import Completion, completions, hidden_points
from tests.geometry.tabletops import Box, Can, looking_at_table, render
from tests.grasping.seen_regions import believed, box_planes, scene_of
from tests.grasping.seen_regions import seen as view_of_box

CONFIG = SelectionConfig()
RESOLUTION = CONFIG.feasibility.scene_resolution
GRIPPER = load_gripper("rg2")
POSE = looking_at_table(elevation=0.6)
TARGET = Can(0.03, 0.06)
BEFORE = Can(0.03, 0.1, (0.02, -0.072, 0.0))  # nearer to the camera, its far side unseen


def seen(*cans):
    """A scene of cans, their regions and their known symmetries."""
    depth, index = render(cans, POSE)
    scene = scene_of(depth, POSE)
    regions = [RegionCloud.from_mask(index == number, scene) for number in range(len(cans))]
    axes = [RotationSymmetry(POSE[:3, 2], transform_points(POSE, can.at)) for can in cans]
    return scene, regions, [believed(axis) for axis in axes]


def wall(can):
    """Points all around a can's side, camera frame."""
    angle, height = np.meshgrid(np.arange(0, 2 * np.pi, 0.05), np.arange(0, can.height, 0.002))
    side = np.stack([can.radius * np.cos(angle), can.radius * np.sin(angle), height], -1)
    return transform_points(POSE, side.reshape(-1, 3) + np.array(can.at))


def met(found, points):
    """Return the number of `points` inside the gripper's bodies at each grasp."""
    grasps = found.grasps
    local = np.einsum("kpi,kij->kpj", points - grasps.translation[:, None], grasps.rotation)
    boxes = GRIPPER.boxes(grasps.width)[:, :, :, None]
    inside = (local[:, None] > boxes[:, :, 0]) & (local[:, None] < boxes[:, :, 1])
    return inside.all(axis=-1).any(axis=1).sum(axis=1)


def planned(scene, region, symmetries, completion):
    model = RegionModel(region, symmetries, np.ones(len(region)), completion)
    return RegionPlanner(GRIPPER, CONFIG).plan(model, scene)


def completed(regions, scene, symmetries):
    return completions(regions, scene, symmetries, CONFIG.symmetry, RESOLUTION)


def test_symmetries_fill_in_the_unseen_side():
    scene, [region], [known] = seen(TARGET)
    hidden = hidden_points(region, known.between(0.5), scene, RESOLUTION)
    local = transform_points(invert(POSE), hidden)
    side = local[(local[:, 2] > 0.005) & (local[:, 2] < 0.055)]
    np.testing.assert_allclose(np.linalg.norm(side[:, :2], axis=1), TARGET.radius, atol=0.002)
    assert (side[:, 1] > 0.02).any()  # the far side
    assert len(hidden_points(region, [], scene, RESOLUTION)) == 0


def test_a_mirror_plane_fills_in_the_back_of_a_box():
    pose, scene, region = view_of_box([Box((0.06, 0.09, 0.1))])
    hidden = hidden_points(region, box_planes(pose, 0.1).between(0.5), scene, RESOLUTION)
    local = transform_points(invert(pose), hidden)
    assert (np.abs(local) < [0.032, 0.047, 0.102]).all()
    back = local[local[:, 1] > 0.043]  # the camera sees the side of y = -0.045
    np.testing.assert_allclose(np.ptp(back[:, [0, 2]], axis=0), [0.06, 0.1], atol=0.01)


def test_each_region_is_completed_by_its_own_symmetries():
    scene, regions, known = seen(TARGET, BEFORE)
    known = [replace(known[0], probability=0.4 * known[0].probability), known[1]]
    first, second = completed(regions, scene, known)
    assert len(first.own) == 0  # confidence too low for its own grasps
    for found, region, each in ((second.own, 1, known[1]), (second.others, 0, known[0])):
        expected = hidden_points(regions[region], each.between(0.3), scene, RESOLUTION)
        assert len(expected) > 0  # enough for grasps of its neighbour to keep clear
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(first.others, second.own)


def test_grasps_keep_clear_of_the_unseen_side_of_a_neighbour():
    scene, regions, known = seen(TARGET, BEFORE)
    both = completed(regions, scene, known)[0]
    alone = Completion(both.own, np.zeros((0, 3)))
    plans = [planned(scene, regions[0], known[0], each) for each in (alone, both)]
    hits = [met(plan, wall(BEFORE)) for plan in plans]
    assert hits[0].max() > 100  # the seen points alone do not prevent a collision
    assert len(plans[1]) > 0
    assert hits[1].max() <= CONFIG.feasibility.max_points_inside


def test_a_region_that_completed_neighbours_leave_no_grasp_is_planned_without_them():
    scene, regions, known = seen(TARGET, BEFORE)
    own = completed(regions, scene, known)[0].own
    rng = np.random.default_rng(0)
    up = rotate_vectors(POSE, [0.0, 0.0, 1.0])
    everywhere = regions[0].middle + 0.05 * up + rng.uniform(-0.1, 0.1, (20_000, 3))
    found, without = (
        planned(scene, regions[0], known[0], Completion(own, others))
        for others in (everywhere, np.zeros((0, 3)))
    )
    assert len(without) > 0
    np.testing.assert_array_equal(found.grasps.translation, without.grasps.translation)
