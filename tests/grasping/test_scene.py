"""Region clouds of a scene: points, normals, pixels and the view ray."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.geometry.transforms import unit
from pipelines.grasping.scene import SceneCloud
from tests.geometry.tabletops import CAMERA, Box
from tests.grasping.seen_regions import seen

_, SCENE, REGION = seen([Box((0.06, 0.06, 0.1))])


def test_some_points_of_a_region_keep_their_normals_and_its_pixels():
    index = np.array([7, 0, 7, 12])
    found = REGION[index]
    np.testing.assert_array_equal(found.points, REGION.points[index])
    np.testing.assert_array_equal(found.normals, REGION.normals[index])
    assert found.mask is REGION.mask


def test_the_view_ray_leads_to_the_middle_of_the_region():
    np.testing.assert_allclose(REGION.view_ray, unit(np.median(REGION.points, axis=0)))


def test_all_that_a_gripper_may_meet_is_an_obstacle_at_any_distance_of_a_region():
    for farther in (0.0, 2.5):
        depth = np.where(SCENE.depth > 0, SCENE.depth + farther, 0.0)
        obstacles = SceneCloud(depth, CAMERA).coarse_obstacles.points
        assert len(obstacles) == len(SceneCloud(SCENE.depth, CAMERA).coarse_obstacles.points) > 0


@pytest.mark.parametrize(("step", "is_stray"), [(0.011, False), (0.013, True), (-0.013, True)])
def test_a_pixel_more_than_12_mm_from_its_neighbours_is_stray(step, is_stray):
    depth = np.full((CAMERA.height, CAMERA.width), 0.7)
    depth[100, 100] += step
    scene = SceneCloud(depth, CAMERA)
    assert (scene.stray.sum(), scene.stray[100, 100]) == (is_stray, is_stray)
    assert scene.near[100, 100] is np.bool_(not is_stray)


def test_the_coarse_obstacles_stand_for_all_pixels():
    camera = replace(CAMERA, width=300)  # a multiple of three
    wall = SceneCloud(np.full((240, 300), 0.7), camera)
    assert wall.coarse_obstacles.count.sum() == 240 * 300


def test_the_ray_is_found_without_a_table():
    alone = SceneCloud(SCENE.depth, CAMERA)
    assert alone.inward is None
    assert REGION.view_ray @ REGION.middle == pytest.approx(np.linalg.norm(REGION.middle))
