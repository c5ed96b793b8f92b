"""Points around a region, measured or unseen, that grasps must avoid."""

import numpy as np
import pytest

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.feasibility.surroundings import Surroundings
from pipelines.grasping.scene import RegionCloud, SceneCloud
from tests.geometry.tabletops import Box, Can, looking_at_table, render
from tests.grasping.seen_regions import scene_of


def seen(seed):
    rng = np.random.default_rng(seed)
    pose = looking_at_table()
    depth, index = render([Box((0.06, 0.06, 0.1)), Can(0.03, 0.12, (0.1, 0.0, 0.0))], pose)
    depth = np.where(rng.random(depth.shape) < 0.05, 0.0, depth)
    scene = scene_of(depth, pose)
    return scene, RegionCloud.from_mask(index == 0, scene)


@pytest.mark.parametrize("reach", [0.02, 0.15, 2.0])
@pytest.mark.parametrize("resolution", [0.003, 0.02])
def test_the_first_point_of_every_cell_in_reach_surrounds_a_region(reach, resolution):
    scene, region = seen(0)
    low, high = region.points.min(axis=0), region.points.max(axis=0)
    center, radius = (low + high) / 2, np.linalg.norm(high - low) / 2 + reach
    points, own = scene.xyz.reshape(-1, 3), region.mask.ravel()
    near = np.linalg.norm(points - center, axis=1) < radius
    points, own = points[near], own[near]
    cells = np.column_stack([np.floor((points - center + radius) / resolution), own])
    _, first, count = np.unique(cells, axis=0, return_index=True, return_counts=True)
    found = Surroundings.of(region, scene, reach, resolution)
    np.testing.assert_array_equal(found.all.points, points[first])
    np.testing.assert_array_equal(found.all.count, count)
    foreign = ~own[first]
    np.testing.assert_array_equal(found.others.points, points[first][foreign])
    np.testing.assert_array_equal(found.others.count, count[foreign])


def test_unseen_points_within_reach_join_the_obstacles():
    scene, region = seen(0)
    around = Surroundings.of(region, scene, 0.1, 0.003)
    unseen = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [5.0, 0.0, 0.0]]) + around.center
    joined = around.with_unseen(unseen)
    np.testing.assert_array_equal(
        joined.all.points, np.concatenate([around.all.points, unseen[:2]])
    )
    np.testing.assert_array_equal(joined.all.count, np.append(around.all.count, [1, 1]))
    assert joined.others is around.others


def test_points_beneath_the_floor_are_no_obstacles_but_points_of_other_regions():
    scene, region = seen(0)
    floor = Plane(scene.plane.normal, scene.plane.offset - 0.03)
    whole, high = (Surroundings.of(region, scene, 0.1, 0.003, each) for each in (None, floor))
    above = floor.height(whole.all.points) > 0.0
    np.testing.assert_array_equal(high.all.points, whole.all.points[above])
    np.testing.assert_array_equal(high.all.count, whole.all.count[above])
    np.testing.assert_array_equal(high.others.points, whole.others.points)
    np.testing.assert_array_equal(high.others.count, whole.others.count)
    unseen = high.center - floor.height(high.center) * floor.normal
    unseen = unseen + np.outer([-0.01, 0.01], floor.normal)
    joined = high.with_unseen(unseen)
    np.testing.assert_array_equal(joined.all.points, np.concatenate([high.all.points, unseen[1:]]))
    assert high.with_unseen(unseen[:1]) is high


@pytest.mark.parametrize("pixel", [(92, 119), (85, 140), (159, 119), (230, 110), (30, 20)])
def test_a_wide_angle_camera_sees_all_points_in_reach(pixel):
    camera = Intrinsics(80.0, 80.0, 159.5, 119.5, 320, 240)  # 127 by 113 degrees
    mask = np.zeros((240, 320), bool)
    mask[pixel[1] - 4 : pixel[1] + 5, pixel[0] - 4 : pixel[0] + 5] = True
    flat = RegionCloud.from_mask(mask, SceneCloud(np.ones((240, 320)), camera))
    low, high = flat.points.min(axis=0), flat.points.max(axis=0)
    center, reach = (low + high) / 2, 0.4
    # The side of the ball that faces the camera is measured, as far as the image shows it.
    radius, rays = np.linalg.norm(high - low) / 2 + reach - 1e-6, camera.rays()
    square, along = (rays**2).sum(axis=-1), rays @ center
    inner = along**2 - square * (center @ center - radius**2)
    depth = (along - np.sqrt(np.maximum(inner, 0.0))) / square
    depth = np.where(mask, 1.0, np.where((inner > 0) & (along > 0), depth, 0.0))
    found = Surroundings.of(flat, SceneCloud(depth, camera), reach, 0.01)
    assert found.all.count.sum() == np.count_nonzero(depth)
