"""Planar grasps, against a loop over all pairs of boundary cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import SelectionConfig
from pipelines.geometry.transforms import unit
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.candidates import planar
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.passes import RegionModel, planar_pass
from pipelines.grasping.planner import RegionPlanner
from pipelines.grasping.scene import RegionCloud
from tests.geometry.tabletops import Box, Can, render
from tests.grasping.seen_regions import scene_of, seen

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")
seeds = st.integers(0, 2**31)


def naive_pairs(view, depth, region):
    """Map the (first, second) contacts of each holding pair of one slice to their quality."""
    inside = planar.cv2.medianBlur((view.depth <= depth).astype(np.uint8), 3)
    boundary, outward = planar._boundary(inside)
    steep = planar._wall_steepness(view.depth, depth, view.cell, boundary, outward)
    ray = region.view_ray @ view.axes[:, 1:]
    contact, found = boundary + 0.5 * outward, {}
    for i in range(len(contact)):
        for j in range(i + 1, len(contact)):
            width = np.linalg.norm(contact[j] - contact[i])
            if not CONFIG.feasibility.min_width < width * view.cell < GRIPPER.max_width:
                continue
            line = (contact[j] - contact[i]) / width
            holding = min(-line @ outward[i], line @ outward[j]) * min(steep[i], steep[j])
            if holding > planar.MIN_HOLDING:
                ends = [1.0 - planar.HIDDEN_PENALTY * max(outward[k] @ ray, 0.0) for k in (i, j)]
                found[tuple(contact[i]), tuple(contact[j])] = holding**2 * min(ends)
    return found


@pytest.mark.parametrize("noise", [0.0, 0.0002])
def test_a_flat_top_seen_from_straight_above_can_be_held_at_its_unseen_sides(noise):
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.7
    depth, index = render([Box((0.05, 0.05, 0.03))], pose)
    depth = depth + noise * np.random.default_rng(0).normal(size=depth.shape)
    scene = scene_of(depth, pose)
    region = RegionModel(RegionCloud.from_mask(index == 0, scene))
    found = RegionPlanner(GRIPPER, CONFIG).plan(region, scene, (planar_pass(),))
    assert len(found)
    np.testing.assert_allclose(found.grasps.width[0], 0.05, atol=0.006)
    assert (found.grasps.translation[:, 2] + GRIPPER.tip_reach < 0.7).all()  # above the table


def test_the_table_bounds_the_contacts_of_a_steep_approach_and_of_no_other():
    pose, scene, region = seen([Box((0.06, 0.05, 0.014))])
    checks = Feasibility.at(region, scene, GRIPPER, CONFIG.feasibility, 0.05)
    tilted = planar.HeightMap.of(region.points, pose[:3, :3] @ [0.0, 0.6, -0.8])
    depths = planar._slice_depths(tilted, region.middle, checks)
    assert len(depths) > 1
    assert all(slice_at == contacts for slice_at, contacts in depths)
    above = planar.HeightMap.of(region.points, -pose[:3, 2])
    depths = planar._slice_depths(above, region.middle, checks)
    tips = [above.points_at(np.zeros((1, 2)), at + GRIPPER.tip_reach) for _, at in depths]
    lowest = CONFIG.feasibility.min_table_distance + CONFIG.feasibility.body_margin
    assert scene.plane.height(np.concatenate(tips)).min() == pytest.approx(lowest)


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.12, 0.1, 0.0), (-0.1, -0.12, 0.0)])
def test_the_deepest_tips_of_a_tilted_approach_are_just_above_the_table(at):
    _, scene, region = seen([Box((0.06, 0.05, 0.014), at)])
    checks = Feasibility.at(region, scene, GRIPPER, CONFIG.feasibility, 0.05)
    lowest = CONFIG.feasibility.min_table_distance + CONFIG.feasibility.body_margin
    for approach in planar.approach_directions(region, scene):
        if -approach @ scene.plane.normal < planar.STEEP_APPROACH:
            continue
        view = planar.HeightMap.of(region.points, approach)
        deepest = max(at for _, at in planar._slice_depths(view, region.middle, checks))
        away = deepest + GRIPPER.tip_reach - region.middle @ approach
        height = scene.plane.height(region.middle + away * approach)
        assert lowest - 1e-9 < height < lowest + 0.001


@pytest.mark.parametrize("shape", [Box((0.06, 0.05, 0.1)), Can(0.03, 0.08)])
def test_the_pairs_of_a_slice_equal_those_of_a_loop(shape):
    _, scene, region = seen([shape, Box((0.03, 0.03, 0.15), (0.0, -0.08, 0.0))])
    cap = CONFIG.ranking.clearance_cap
    checks = Feasibility.at(region, scene, GRIPPER, CONFIG.feasibility, cap)
    for approach in planar.approach_directions(region, scene):
        view = planar.HeightMap.of(region.points, approach)
        for at, _ in planar._slice_depths(view, region.middle, checks):
            expected = naive_pairs(view, at, region)
            cells, quality = planar._slice_pairs(view, at, region, checks)
            keys = np.array([np.ravel(pair) for pair in expected]).reshape(-1, 4)
            values = np.array(list(expected.values()))
            assert len(cells) <= planar.MAX_PAIRS
            assert (len(cells) > 0) == (len(expected) > 0)
            for pair, value in zip(cells.reshape(-1, 4), quality, strict=True):
                away = np.abs(keys - pair).max(axis=1)
                assert away.min() < 1e-6
                assert values[away.argmin()] == pytest.approx(value)
            if len(expected):
                assert quality.max() == pytest.approx(values.max())


@given(seeds, st.integers(1, 200))
@settings(max_examples=25, deadline=None)
def test_a_cell_holds_the_depth_of_its_nearest_point(seed, count):
    rng = np.random.default_rng(seed)
    local = rng.uniform(-0.05, 0.05, (count, 3)) * rng.choice([0.05, 1.0, 8.0], 3)
    low, cell, depth = planar._nearest_in_cells(local)
    np.testing.assert_array_equal(low, local[:, 1:].min(axis=0))
    extent = np.ptp(local[:, 1:], axis=0)
    assert cell == max(planar.MIN_CELL, extent.max() / planar.MAX_CELLS)
    expected = np.full((extent[::-1] / cell).astype(int) + 1 + 2 * planar.MARGIN, np.inf)
    column, row = ((local[:, 1:] - low) / cell).astype(int).T + planar.MARGIN
    np.minimum.at(expected, (row, column), local[:, 0])
    np.testing.assert_array_equal(depth, expected)


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_a_cell_lies_about_its_points(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.05, 0.05, (60, 3))
    view = planar.HeightMap.of(points, unit(rng.normal(size=3)))
    flat = view.across(points)
    cells = np.floor((flat - view.low) / view.cell + 1e-6).astype(int)
    assert np.isfinite(view.depth[cells[:, 1], cells[:, 0]]).all()
    away = view.across(view.points_at(cells, 0.3)) - flat
    assert np.abs(away).max() <= view.cell * 0.500001


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_holes_take_the_depth_of_the_nearest_cell_around(seed):
    rng = np.random.default_rng(seed)
    depth = np.where(rng.uniform(size=(12, 9)) < 0.7, rng.uniform(size=(12, 9)), np.inf)
    inside = (rng.uniform(size=(12, 9)) < 0.5).astype(np.uint8)
    near = planar.cv2.erode(depth, np.ones((5, 5), np.uint8), borderValue=np.inf)
    expected = np.where(np.isfinite(depth) | (inside == 0), depth, near)
    np.testing.assert_array_equal(planar._filled(depth, inside), expected)


@given(seeds, st.integers(0, 20))
@settings(max_examples=25, deadline=None)
def test_slopes_and_steepness_equal_those_of_numpy_arrays(seed, count):
    rng = np.random.default_rng(seed)
    smooth, cells = rng.uniform(size=(15, 20)), rng.integers(1, [19, 14], (count, 2))
    column, row = cells.T
    slopes = [planar.cv2.Sobel(smooth, planar.cv2.CV_64F, *axis) for axis in ((1, 0), (0, 1))]
    expected = np.stack([slope[row, column] for slope in slopes], 1)
    np.testing.assert_allclose(planar._slopes(smooth, cells), expected, atol=1e-12)

    depth = np.where(rng.uniform(size=(15, 20)) < 0.5, smooth, np.inf)
    outward = rng.normal(size=(count, 2))
    u, v = np.clip(np.round(cells + 2.5 * outward), 0, [19, 14]).astype(int).T
    fall = np.where(np.isfinite(depth[v, u]), np.maximum(depth[v, u] - 0.4, 0.0), 1.0)
    expected = np.sin(np.arctan2(fall, 2.5 * 0.1))
    found = planar._wall_steepness(depth, 0.4, 0.1, cells.astype(float), outward)
    np.testing.assert_allclose(found, expected)


@given(seeds, st.integers(0, 200))
@settings(max_examples=25, deadline=None)
def test_the_first_of_pairs_around_one_place_is_taken(seed, count):
    rng = np.random.default_rng(seed)
    contact, pairs = rng.uniform(-20.0, 20.0, (40, 2)), rng.integers(40, size=(count, 2))
    order = rng.permutation(count)
    place = np.floor(contact[pairs[order]].mean(axis=1) / planar.PLACE)
    _, first = np.unique(place, axis=0, return_index=True)
    expected = order[np.sort(first)[: planar.MAX_PAIRS]]
    np.testing.assert_array_equal(planar._spread(contact, pairs, order), expected)
