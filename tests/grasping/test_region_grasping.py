"""From a region to ranked grasps: by symmetry, from the boundary, at random."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.configs import SelectionConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping import region_grasping
from pipelines.grasping.feasibility.collision import lowest_height
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.ranking.suppression import are_near
from pipelines.grasping.region_grasping import plan_planar, plan_random, plan_region
from pipelines.grasping.selection import select
from tests.geometry.tabletops import CAMERA, Ball, Box, Can, looking_at_table, render

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")


def seen(shapes, pose=None):
    pose = looking_at_table() if pose is None else pose
    depth, index = render(shapes, pose)
    scene = SceneCloud(depth, CAMERA, Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3])))
    return pose, scene, RegionCloud.from_mask(index == 0, scene)


def box_planes(pose, height):
    middle = transform_points(pose, [0, 0, height / 2])
    planes = [ReflectionSymmetry(pose[:3, axis], middle) for axis in (0, 1)]
    return SymmetrySlots.from_symmetries(planes)


def gripper_points(grasps, index, scene):
    """Measured points inside the bodies of one grasp's hand."""
    points = scene.xyz[scene.depth > 0]
    local = (points - grasps.translation[index]) @ grasps.rotation[index]
    boxes = GRIPPER.boxes(grasps.width[index : index + 1])[0]
    return sum(((local > low) & (local < high)).all(1).sum() for low, high in boxes)


def test_a_symmetric_box_is_held_across_its_planes():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    slots = box_planes(pose, 0.1)
    config = replace(CONFIG, opening_margins=())
    found = plan_region(region, scene, slots, np.ones(len(region)), GRIPPER, config)
    assert set(found.source) == {"network"}
    closing = np.abs(rotate_vectors(invert(pose), found.grasps.closing))
    width = np.where(found.slot == 0, 0.06, 0.09)
    np.testing.assert_allclose(found.grasps.width, width, atol=0.006)
    assert (closing[np.arange(len(found)), found.slot] > 0.99).all()
    roomy = plan_region(region, scene, slots, np.ones(len(region)), GRIPPER, CONFIG)
    np.testing.assert_allclose(roomy.grasps.width - found.grasps.width, CONFIG.opening_margins[0])


def test_without_a_symmetry_the_boundary_serves():
    _, scene, region = seen([Box((0.06, 0.09, 0.1))])
    nothing = SymmetrySlots.empty()
    found = plan_region(region, scene, nothing, np.ones(len(region)), GRIPPER, CONFIG)
    assert len(found) > 0
    assert set(found.source) == {"planar"}
    assert set(found.slot) == {-1}


SHAPES = {
    "box": Box((0.06, 0.09, 0.1), yaw=0.4),
    "flat box": Box((0.07, 0.15, 0.03), yaw=0.2),
    "can": Can(0.035, 0.12),
    "tuna can": Can(0.042, 0.035),
    "ball": Ball(0.035, (0, 0, 0.035)),
    "lying bar": Box((0.18, 0.025, 0.025), yaw=1.0),
}


@pytest.mark.parametrize("name", SHAPES)
def test_every_common_shape_gets_a_planar_grasp_about_its_middle(name):
    pose, scene, region = seen([SHAPES[name]])
    found = plan_planar(region, scene, GRIPPER, CONFIG)
    assert len(found) > 0
    middle = transform_points(invert(pose), found.grasps.translation[:1])[0]
    assert np.linalg.norm(middle[:2]) < 0.05
    assert middle[2] > 0.0
    assert gripper_points(found.grasps, 0, scene) <= CONFIG.max_points_inside


def test_the_planar_width_is_the_objects():
    pose, scene, region = seen([Box((0.06, 0.18, 0.1))])  # 18 cm is too wide for the hand
    found = plan_planar(region, scene, GRIPPER, CONFIG)
    assert abs(found.grasps.width[0] - 0.06) < 0.012
    closing = rotate_vectors(invert(pose), found.grasps.closing[0])
    assert abs(closing[0]) > 0.97


def test_no_planar_grasp_touches_scene_or_table():
    shapes = [
        Box((0.05, 0.08, 0.07)),
        Can(0.03, 0.12, (0.085, 0, 0)),
        Box((0.3, 0.02, 0.1), (0, 0.1, 0)),
    ]
    _, scene, region = seen(shapes)
    found = plan_planar(region, scene, GRIPPER, CONFIG)
    assert len(found) > 0
    assert (lowest_height(found.grasps, GRIPPER, scene.plane) >= CONFIG.min_table_distance).all()
    inside = [gripper_points(found.grasps, index, scene) for index in range(len(found))]
    assert max(inside) <= CONFIG.max_points_inside


def test_what_is_wider_than_the_gripper_gets_no_grasp():
    _, scene, region = seen([Box((0.2, 0.2, 0.2))])
    assert len(plan_planar(region, scene, GRIPPER, CONFIG)) == 0


def test_without_a_table_the_hand_comes_along_the_view():
    _, scene, region = seen([Box((0.06, 0.09, 0.1))])
    alone = SceneCloud(scene.depth, CAMERA, None)
    found = plan_planar(region, alone, GRIPPER, CONFIG)
    assert len(found) > 0
    view = found.grasps.translation / np.linalg.norm(found.grasps.translation, axis=1)[:, None]
    cosine = np.einsum("ni,ni->n", found.grasps.approach, view)
    assert (cosine > np.cos(CONFIG.max_view_angle)).all()


def test_rolling_the_camera_by_half_a_turn_turns_the_grasp():
    roll = np.diag([-1.0, -1.0, 1.0, 1.0])
    pose, scene, region = seen([Box((0.06, 0.18, 0.1))])
    _, turned_scene, turned_region = seen([Box((0.06, 0.18, 0.1))], roll @ pose)
    here = plan_planar(region, scene, GRIPPER, CONFIG).grasps[:1].transformed(roll)
    there = plan_planar(turned_region, turned_scene, GRIPPER, CONFIG).grasps[:1]
    np.testing.assert_allclose(here.width, there.width, atol=0.006)
    np.testing.assert_allclose(here.translation, there.translation, atol=0.025)
    assert abs(float(np.sum(here.closing * there.closing))) > 0.97


def test_random_grasps_are_feasible_and_repeat_with_their_seed():
    _, scene, region = seen([Can(0.03, 0.12)])
    plans = [
        plan_random(region, scene, GRIPPER, CONFIG, np.random.default_rng(3)) for _ in range(2)
    ]
    np.testing.assert_array_equal(plans[0].grasps.translation, plans[1].grasps.translation)
    for index in range(len(plans[0])):
        assert gripper_points(plans[0].grasps, index, scene) <= CONFIG.max_points_inside


def shrunk(region, size):
    """30 points of a region, no two of them farther apart than `size` metres."""
    few = region[np.linspace(0, len(region) - 1, 30).astype(int)]
    reach = np.linalg.norm(few.points - few.middle, axis=1).max()
    return replace(few, points=few.middle + (few.points - few.middle) * size / (2 * reach))


def test_a_region_smaller_than_any_width_has_no_random_grasp():
    _, scene, region = seen([Can(0.03, 0.12)])
    small = shrunk(region, 0.9 * CONFIG.min_width)
    assert len(plan_random(small, scene, GRIPPER, CONFIG, np.random.default_rng(3))) == 0


def test_where_nothing_antipodal_is_seen_random_pairs_still_have_a_width_that_fits(monkeypatch):
    _, scene, region = seen([Can(0.03, 0.12)])
    flat = replace(region, normals=np.tile(-region.view_ray, (len(region), 1)))
    tried = []

    def remember(candidates, *rest):
        tried.append(candidates.contacts)
        return select(candidates, *rest)

    monkeypatch.setattr(region_grasping, "select", remember)
    for cloud in (flat, shrunk(flat, 1.5 * CONFIG.min_width)):
        plan_random(cloud, scene, GRIPPER, CONFIG, np.random.default_rng(3))
    for contacts in tried:
        width = np.linalg.norm(contacts[:, 1] - contacts[:, 0], axis=1)
        assert 0 < len(width) <= CONFIG.max_pairs
        assert width.min() >= CONFIG.min_width
        assert width.max() <= GRIPPER.max_width
    assert len(tried) == 2


def test_a_false_symmetry_costs_nothing_but_the_fallback():
    pose, scene, region = seen([Can(0.035, 0.12)])
    wrong = RotationSymmetry(pose[:3, 0], transform_points(pose, [0, 0, 0.3]))
    slots = SymmetrySlots.from_symmetries([wrong])
    found = plan_region(region, scene, slots, np.ones(len(region)), GRIPPER, CONFIG)
    assert set(found.source) == {"planar"}


class Expecting:
    """A critic that expects the more, the nearer a hand's closing is to `direction`."""

    def __init__(self, direction, most=1.0):
        self.direction, self.most = direction, most

    def expect(self, views):
        return self.most * np.abs(views.found.grasps.closing @ self.direction)


def judged(scene, region, slots, critic, config=CONFIG):
    return plan_region(region, scene, slots, np.ones(len(region)), GRIPPER, config, critic)


def test_a_judge_decides_which_plane_the_best_grasp_is_across():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    for axis in (0, 1):
        found = judged(scene, region, box_planes(pose, 0.1), Expecting(pose[:3, axis]))
        assert abs(found.grasps.closing[0] @ pose[:3, axis]) > 0.99
        assert (np.diff(found.rank_score) <= 1e-6).all()


def test_planar_grasps_join_where_little_is_expected_of_symmetric_ones():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    slots = box_planes(pose, 0.1)
    config = replace(CONFIG, planar_below=0.5)
    sure = judged(scene, region, slots, Expecting(pose[:3, 1]), config)
    assert set(sure.source) == {"network"}
    unsure = judged(scene, region, slots, Expecting(pose[:3, 1], most=0.4), config)
    assert set(unsure.source) <= {"network", "planar"}
    assert "planar" in unsure.source
    assert (np.diff(unsure.rank_score) <= 1e-6).all()
    near = are_near(unsure.grasps, config.nms_distance, config.nms_angle)
    assert not np.triu(near, 1).any()


def test_doubted_planes_are_asked_where_little_is_expected_of_all_else():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    slots = box_planes(pose, 0.1)
    slots.existence[1] = CONFIG.min_confidence / 2  # across the pose's y
    sure = judged(scene, region, slots, Expecting(pose[:3, 0]))
    assert len(sure)
    assert 1 not in sure.slot
    unsure = judged(scene, region, slots, Expecting(pose[:3, 1]))
    assert unsure.slot[0] == 1
    assert (np.diff(unsure.rank_score) <= 1e-6).all()
    slots.existence[1] = CONFIG.min_doubtful_confidence / 2
    assert 1 not in judged(scene, region, slots, Expecting(pose[:3, 1])).slot


def test_a_region_of_a_few_pixels_gives_no_grasps():
    _, scene, region = seen([Can(0.03, 0.12)])
    tiny = RegionCloud(region.points[:5], region.normals[:5], region.mask)
    assert len(plan_planar(tiny, scene, GRIPPER, CONFIG)) == 0
