"""No finger goes where the image border cuts off a region, which goes on beyond it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import SelectionConfig
from pipelines.geometry.transforms import random_rotation
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.image_border import BACK, ImageBorder
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.passes import RegionModel, planar_pass
from pipelines.grasping.planner import RegionPlanner
from pipelines.grasping.scene import RegionCloud, measured_sides
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render
from tests.grasping.seen_regions import scene_of

CONFIG, GRIPPER = SelectionConfig(), load_gripper("rg2")
BOX = Box((0.09, 0.05, 0.06))
POSE = looking_at_table()
SIDES = ["left", "right", "upper", "lower", "none"]


def cut(depth, index, side, share=0.6):
    """Return depth, region and camera of an image that shows only `share` of the box."""
    rows, columns = np.nonzero(index == 0)
    match side:
        case "left":
            some = slice(None), slice(int(np.quantile(columns, 1 - share)), None)
        case "right":
            some = slice(None), slice(0, int(np.quantile(columns, share)) + 1)
        case "upper":
            some = slice(int(np.quantile(rows, 1 - share)), None), slice(None)
        case "lower":
            some = slice(0, int(np.quantile(rows, share)) + 1), slice(None)
        case _:
            some = slice(None), slice(None)
    first = [each.start or 0 for each in some]
    camera = replace(CAMERA, cx=CAMERA.cx - first[1], cy=CAMERA.cy - first[0])
    depth, mask = depth[some], (index == 0)[some]
    return depth, mask, replace(camera, width=depth.shape[1], height=depth.shape[0])


@pytest.mark.parametrize("side", SIDES)
def test_a_region_is_cut_where_it_reaches_the_border_of_the_measured_pixels(side):
    depth, mask, camera = cut(*render([BOX], POSE), side)
    border = ImageBorder.of(mask, depth, measured_sides(depth), camera)
    if side == "none":
        assert border is None
        return
    ends = np.isfinite([border.low[0], border.high[0], border.low[1], border.high[1]])
    np.testing.assert_array_equal(ends, np.array(SIDES[:4]) == side)


def test_pixels_of_a_region_without_depth_cut_it_nowhere():
    depth, mask = np.full((240, 320), 0.7), np.zeros((240, 320), bool)
    mask[100:140, :60] = True
    sides = (0, 319), (0, 239)
    assert ImageBorder.of(mask, depth, sides, CAMERA).low.tolist() == [0.0, -np.inf]
    depth[100:140, :10] = 0.0
    assert ImageBorder.of(mask, depth, sides, CAMERA) is None


@pytest.mark.parametrize("side", range(4))
def test_a_region_within_four_pixels_of_any_side_is_cut_there(side):
    depth = np.full((240, 320), 0.7)
    for away, is_cut in ((3, True), (4, False)):
        mask = np.zeros((240, 320), bool)
        turned = np.rot90(mask, side)  # a view: its first column is one of the sides
        turned[100:140, away] = True
        border = ImageBorder.of(mask, depth, measured_sides(depth), CAMERA)
        assert (border is not None) is is_cut


@pytest.mark.parametrize("side", SIDES)
def test_no_finger_closes_where_the_image_cuts_an_object_off(side):
    whole, index = render([BOX], POSE)
    depth, mask, camera = cut(whole, index, side)
    scene = scene_of(depth, POSE, camera)
    region = RegionModel(RegionCloud.from_mask(mask, scene))
    found = RegionPlanner(GRIPPER, CONFIG).plan(region, scene, (planar_pass(),))
    assert len(found)
    grasps = found.grasps
    points = CAMERA.backproject(whole)[index == 0]  # including points beyond the cut
    for n in range(len(found)):
        along, across, aside = ((points - grasps.translation[n]) @ grasps.rotation[n]).T
        half = 0.5 * grasps.width[n] + GRIPPER.clearance
        finger = (np.abs(across) > half) & (np.abs(across) < half + GRIPPER.finger_thickness)
        finger &= (along < GRIPPER.tip_reach) & (along > -GRIPPER.finger_length)
        finger &= np.abs(aside) < 0.5 * GRIPPER.finger_height
        assert np.count_nonzero(finger) <= CONFIG.feasibility.max_points_inside


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000))
def test_a_grasp_is_kept_if_its_fingers_are_in_view(seed):
    rng = np.random.default_rng(seed)
    low = np.array([rng.uniform(0, 100), -np.inf])
    high = np.array([np.inf, rng.uniform(140, 239)])
    rotation = np.stack([random_rotation(rng) for _ in range(20)])
    middle = np.column_stack([rng.uniform(-0.3, 0.3, (20, 2)), rng.uniform(0.02, 0.8, 20)])
    grasps = GraspPoses.unchecked(rotation, middle, rng.uniform(0.01, 0.09, 20))
    kept = ImageBorder(CAMERA, low, high).allows(grasps, GRIPPER)
    for n in range(20):
        out = 0.5 * grasps.width[n] + GRIPPER.clearance + GRIPPER.finger_thickness
        inside = True
        for across in (-out, out):
            for along in (GRIPPER.tip_reach, GRIPPER.tip_reach - BACK):
                x, y, z = middle[n] + rotation[n] @ [along, across, 0.0]
                if z <= 0:
                    inside = False
                    continue
                u, v = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
                inside &= bool(u >= low[0] and v <= high[1])
        assert kept[n] == inside


def test_a_side_that_a_camera_never_measures_counts_as_image_border():
    depth = np.full((240, 320), 0.7)
    depth[:, :30] = 0.0
    depth[5, 3] = 0.7  # noise
    assert measured_sides(depth) == ((30, 319), (0, 239))
    assert measured_sides(np.zeros((4, 6))) == ((0, 5), (0, 3))


def test_an_object_on_an_otherwise_empty_depth_image_is_not_cut():
    depth, index = render([BOX], POSE)
    alone = np.where(index == 0, depth, 0.0)
    assert measured_sides(alone) == ((0, 319), (0, 239))
    assert ImageBorder.of(index == 0, alone, measured_sides(alone), CAMERA) is None
