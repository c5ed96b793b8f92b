"""Grasps of a region: passes over the region, checks of a grasp, order of the kept grasps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import LimitsConfig, SelectionConfig
from pipelines.geometry.symmetry import RotationSymmetry
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.candidates.candidates import GraspCandidates
from pipelines.grasping.feasibility.collision import lowest_height
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.limits import Limits
from pipelines.grasping.passes import Pass, RegionModel, planar_pass, random_pass
from pipelines.grasping.planner import RegionPlanner, _centeredness
from pipelines.grasping.ranking.ranking import are_near
from pipelines.grasping.scene import RegionCloud, SceneCloud
from tests.geometry.tabletops import CAMERA, Ball, Box, Can
from tests.grasping.seen_regions import believed, box_planes, seen

CONFIG = SelectionConfig()
CHECKS, RANKING = CONFIG.feasibility, CONFIG.ranking
GRIPPER = load_gripper("rg2")


def changed(config=CONFIG, **groups):
    """Return `config` with other settings in some of its groups."""
    return replace(
        config, **{name: replace(getattr(config, name), **each) for name, each in groups.items()}
    )


NARROW = changed(feasibility={"opening_margins": ()})  # the margin is tested elsewhere


def symmetric(region, scene, symmetries, config=CONFIG, critic=None):
    model = RegionModel(region, symmetries, np.ones(len(region)))
    return RegionPlanner(GRIPPER, config, critic).plan(model, scene)


def planar(region, scene):
    return RegionPlanner(GRIPPER, CONFIG).plan(RegionModel(region), scene, (planar_pass(),))


def random(region, scene):
    only = (random_pass(np.random.default_rng(3)),)
    return RegionPlanner(GRIPPER, CONFIG).plan(RegionModel(region), scene, only)


def points_inside(grasps, index, scene):
    """Measured points inside the gripper's bodies of one grasp."""
    points = scene.xyz[scene.depth > 0]
    local = (points - grasps.translation[index]) @ grasps.rotation[index]
    boxes = GRIPPER.boxes(grasps.width[index : index + 1])[0]
    return sum(((local > low) & (local < high)).all(1).sum() for low, high in boxes)


def test_a_symmetric_box_is_held_across_its_planes():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    found = symmetric(region, scene, box_planes(pose, 0.1), NARROW)
    assert set(found.source) == {"network"}
    closing = np.abs(rotate_vectors(invert(pose), found.grasps.closing))
    width = np.where(found.slot == 0, 0.06, 0.09)
    np.testing.assert_allclose(found.grasps.width, width, atol=0.006)
    assert (closing[np.arange(len(found)), found.slot] > 0.99).all()
    wider = symmetric(region, scene, box_planes(pose, 0.1))
    np.testing.assert_allclose(wider.grasps.width - found.grasps.width, CHECKS.opening_margins[0])


def test_a_region_without_a_symmetry_gets_planar_grasps():
    _, scene, region = seen([Box((0.06, 0.09, 0.1))])
    found = symmetric(region, scene, believed())
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
    found = planar(region, scene)
    assert len(found) > 0
    middle = transform_points(invert(pose), found.grasps.translation[:1])[0]
    assert np.linalg.norm(middle[:2]) < 0.05
    assert middle[2] > 0.0
    assert points_inside(found.grasps, 0, scene) <= CHECKS.max_points_inside


def test_the_width_of_a_planar_grasp_is_that_of_the_object():
    pose, scene, region = seen([Box((0.06, 0.18, 0.1))])  # 18 cm is too wide for the gripper
    found = planar(region, scene)
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
    found = planar(region, scene)
    assert len(found) > 0
    assert (lowest_height(found.grasps, GRIPPER, scene.plane) >= CHECKS.min_table_distance).all()
    inside = [points_inside(found.grasps, index, scene) for index in range(len(found))]
    assert max(inside) <= CHECKS.max_points_inside


def test_an_object_wider_than_the_gripper_gets_no_grasp():
    _, scene, region = seen([Box((0.2, 0.2, 0.2))])
    assert len(planar(region, scene)) == 0


def test_without_a_table_the_gripper_comes_along_the_view():
    _, scene, region = seen([Box((0.06, 0.09, 0.1))])
    found = planar(region, SceneCloud(scene.depth, CAMERA, None))
    assert len(found) > 0
    view = found.grasps.translation / np.linalg.norm(found.grasps.translation, axis=1)[:, None]
    cosine = np.einsum("ni,ni->n", found.grasps.approach, view)
    assert (cosine > np.cos(CHECKS.max_view_angle)).all()


def test_rolling_the_camera_by_half_a_turn_turns_the_grasp():
    roll = np.diag([-1.0, -1.0, 1.0, 1.0])
    pose, scene, region = seen([Box((0.06, 0.18, 0.1))])
    _, turned_scene, turned_region = seen([Box((0.06, 0.18, 0.1))], roll @ pose)
    here = planar(region, scene).grasps[:1].transformed(roll)
    there = planar(turned_region, turned_scene).grasps[:1]
    np.testing.assert_allclose(here.width, there.width, atol=0.006)
    np.testing.assert_allclose(here.translation, there.translation, atol=0.025)
    assert abs(float(np.sum(here.closing * there.closing))) > 0.97


def test_random_grasps_are_feasible_and_repeat_with_their_seed():
    _, scene, region = seen([Can(0.03, 0.12)])
    plans = [random(region, scene) for _ in range(2)]
    np.testing.assert_array_equal(plans[0].grasps.translation, plans[1].grasps.translation)
    for index in range(len(plans[0])):
        assert points_inside(plans[0].grasps, index, scene) <= CHECKS.max_points_inside


def shrunk(region, size):
    """30 points of a region, no two of them farther apart than `size` metres."""
    few = region[np.linspace(0, len(region) - 1, 30).astype(int)]
    reach = np.linalg.norm(few.points - few.middle, axis=1).max()
    return replace(few, points=few.middle + (few.points - few.middle) * size / (2 * reach))


def test_a_region_smaller_than_any_width_has_no_random_grasp():
    _, scene, region = seen([Can(0.03, 0.12)])
    assert len(random(shrunk(region, 0.9 * CHECKS.min_width), scene)) == 0


def test_without_antipodal_points_random_pairs_still_have_a_width_that_fits():
    _, scene, region = seen([Can(0.03, 0.12)])
    flat = replace(region, normals=np.tile(-region.view_ray, (len(region), 1)))
    for cloud in (flat, shrunk(flat, 1.5 * CHECKS.min_width)):
        checks = Feasibility.at(cloud, scene, GRIPPER, CHECKS, RANKING.clearance_cap)
        drawn = random_pass(np.random.default_rng(3)).candidates(
            RegionModel(cloud), checks, CONFIG.candidates
        )
        width = np.linalg.norm(drawn.contacts[:, 1] - drawn.contacts[:, 0], axis=1)
        assert 0 < len(width) <= CONFIG.candidates.max_pairs
        assert width.min() >= CHECKS.min_width
        assert width.max() <= GRIPPER.max_width


def test_a_point_drawn_twice_is_no_random_pair_without_a_least_width():
    _, scene, region = seen([Can(0.03, 0.12)])
    few = replace(region, points=region.points[:3], normals=np.tile(-region.view_ray, (3, 1)))
    checks = Feasibility.at(few, scene, GRIPPER, replace(CHECKS, min_width=0.0), 0.05)
    drawn = random_pass(np.random.default_rng(3)).candidates(
        RegionModel(few), checks, CONFIG.candidates
    )
    assert len(GraspPoses.from_contacts(drawn.contacts, drawn.approach)) == len(drawn) > 0


def test_a_false_symmetry_loses_no_planar_grasps():
    pose, scene, region = seen([Can(0.035, 0.12)])
    wrong = RotationSymmetry(pose[:3, 0], transform_points(pose, [0, 0, 0.3]))
    assert set(symmetric(region, scene, believed(wrong)).source) == {"planar"}


class Expecting:
    """A critic whose score grows as a grasp's closing axis nears `direction`."""

    def __init__(self, direction, most=1.0):
        self.direction, self.most = direction, most

    def __call__(self, features):
        return self.most * np.abs(features.feasible.grasps.closing @ self.direction)


def test_the_critic_decides_on_the_plane_of_the_best_grasp():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    for axis in (0, 1):
        critic = Expecting(pose[:3, axis])
        found = symmetric(region, scene, box_planes(pose, 0.1), critic=critic)
        assert abs(found.grasps.closing[0] @ pose[:3, axis]) > 0.99
        assert (np.diff(found.rank_score) <= 1e-6).all()


def test_planar_grasps_join_where_symmetric_grasps_score_low():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    planes = box_planes(pose, 0.1)
    config = changed(ranking={"sufficient": 0.5, "alternatives": 0})
    sure = symmetric(region, scene, planes, config, Expecting(pose[:3, 1]))
    assert set(sure.source) == {"network"}
    unsure = symmetric(region, scene, planes, config, Expecting(pose[:3, 1], most=0.4))
    assert set(unsure.source) <= {"network", "planar"}
    assert "planar" in unsure.source
    assert (np.diff(unsure.rank_score) <= 1e-6).all()
    near = are_near(unsure.grasps, RANKING.nms_distance, RANKING.nms_angle)
    assert not np.triu(near, 1).any()


def test_other_kinds_of_grasps_fill_a_short_list_after_the_best():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    planes, across = box_planes(pose, 0.1), Expecting(pose[:3, :2] @ [0.8, 0.5])
    planes.probability[0] = 0.0  # planar grasps across x score higher than symmetric ones across y
    alone, filled = (
        symmetric(
            region,
            scene,
            planes,
            changed(ranking={"sufficient": 0.0, "alternatives": most}),
            across,
        )
        for most in (0, 20)
    )
    assert 0 < len(alone) < 20
    assert set(alone.source) == {"network"}
    assert "planar" in filled.source
    np.testing.assert_array_equal(filled.grasps.translation[0], alone.grasps.translation[0])
    np.testing.assert_allclose(filled.rank_score[:2], alone.rank_score[0])
    assert (np.diff(filled.rank_score) <= 1e-6).all()
    assert not np.triu(are_near(filled.grasps, RANKING.nms_distance, RANKING.nms_angle), 1).any()


def test_a_long_list_is_not_filled():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    planes, across = box_planes(pose, 0.1), Expecting(pose[:3, 0])
    ranking = {"sufficient": 0.0, "alternatives": 0}
    alone = symmetric(region, scene, planes, changed(ranking=ranking), across)
    ranking["alternatives"] = len(alone)
    same = symmetric(region, scene, planes, changed(ranking=ranking), across)
    np.testing.assert_array_equal(same.rank_score, alone.rank_score)


def test_doubtful_planes_are_tried_where_all_other_grasps_score_low():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    planes, bounds = box_planes(pose, 0.1), CONFIG.symmetry
    planes.probability[1] = bounds.min_confidence / 2  # across the pose's y
    alone = changed(ranking={"alternatives": 0})
    sure = symmetric(region, scene, planes, alone, Expecting(pose[:3, 0]))
    assert len(sure)
    assert 1 not in sure.slot
    unsure = symmetric(region, scene, planes, critic=Expecting(pose[:3, 1]))
    assert unsure.slot[0] == 1
    assert (np.diff(unsure.rank_score) <= 1e-6).all()


def test_a_region_of_a_few_pixels_gives_no_grasps():
    _, scene, region = seen([Can(0.03, 0.12)])
    tiny = RegionCloud(region.points[:5], region.normals[:5], region.mask)
    assert len(planar(tiny, scene)) == 0


# The selection from given contact pairs.

ANGLES = np.radians(np.arange(0, 360, 30))
STRAIGHT = np.zeros(1)
SEEN = seen([Box((0.06, 0.06, 0.12))])


def across_box(pose, heights, x=0.0, size=0.06, angles=ANGLES):
    """GraspCandidates on the left and right faces of a box at `x`, straight from above."""
    pairs = [[[x - size / 2, 0, h], [x + size / 2, 0, h]] for h in heights]
    count = len(heights)
    return GraspCandidates(
        transform_points(pose, np.array(pairs)),
        np.tile(-pose[:3, 2], (count, 1)),
        angles,
        np.ones(count),
        np.linspace(1.0, 0.5, count),
        np.zeros(count, np.int64),
        "network",
    )


def chosen(candidates, region, scene, config=NARROW, critic=None):
    planner = RegionPlanner(GRIPPER, config, critic)
    return planner.plan(RegionModel(region), scene, (Pass(lambda *_: candidates),))


def test_a_grasp_from_above_is_feasible():
    pose, scene, region = SEEN
    found = chosen(across_box(pose, [0.1, 0.09, 0.08]), region, scene)
    assert len(found) > 0
    assert (np.diff(found.rank_score) <= 1e-6).all()


def test_no_finger_goes_below_the_table():
    pose, scene, region = SEEN
    found = chosen(across_box(pose, [0.003, 0.006, 0.02, 0.1]), region, scene)
    lowest = lowest_height(found.grasps, GRIPPER, scene.plane)
    assert (lowest >= CHECKS.min_table_distance).all()
    assert len(chosen(across_box(pose, [0.003]), region, scene)) == 0


def test_a_neighbour_at_a_finger_forbids_the_grasp():
    beside = seen([Box((0.06, 0.06, 0.12)), Box((0.05, 0.06, 0.12), (0.06, 0, 0))])
    for (pose, scene, region), expected in ((SEEN, 1), (beside, 0)):
        found = chosen(across_box(pose, [0.1], angles=STRAIGHT), region, scene)
        assert len(found) == expected


def test_a_neighbour_nearby_lowers_the_clearance():
    clearances = []
    for gap in (0.02, 0.035):
        neighbor = Box((0.05, 0.06, 0.12), (0.03 + gap + 0.025, 0, 0))
        pose, scene, region = seen([Box((0.06, 0.06, 0.12)), neighbor])
        found = chosen(across_box(pose, [0.1], angles=STRAIGHT), region, scene)
        clearances.append(float(found.clearance[0]))
    assert clearances[0] < clearances[1]
    # A finger reaches from the box's face by its clearance and thickness.
    outer = GRIPPER.clearance + GRIPPER.finger_thickness
    np.testing.assert_allclose(clearances, [0.02 - outer, 0.035 - outer], atol=0.004)


def test_fingers_inside_the_object_itself_are_a_collision():
    pose, scene, region = seen([Box((0.1, 0.06, 0.12))])
    # Contacts in the middle of the top face: the fingers would have to go through it.
    assert len(chosen(across_box(pose, [0.1], angles=STRAIGHT), region, scene)) == 0


@pytest.mark.parametrize("width", [0.0005, 0.2])
def test_contacts_too_close_or_too_far_apart_are_left_out(width):
    pose, scene, region = SEEN
    assert len(chosen(across_box(pose, [0.1], size=width), region, scene)) == 0


def test_no_candidates_give_no_grasps():
    _, scene, region = SEEN
    assert len(chosen(GraspCandidates.none(ANGLES, "network"), region, scene)) == 0


def naive_choice(candidates, region, scene):
    """The free grasps, checked pair by pair and angle by angle against all points."""
    around = Feasibility.at(region, scene, GRIPPER, CHECKS, RANKING.clearance_cap).around.all
    base = GraspPoses.from_contacts(candidates.contacts, candidates.approach)
    center = np.median(region.points, axis=0)
    radius = np.percentile(np.linalg.norm(region.points - center, axis=1), 90)
    off = np.linalg.norm(base.translation - center, axis=1) / radius
    stability = candidates.stability * (1.0 - 0.5 * np.minimum(off, 1.0))
    found = []
    for pair in np.argsort(-stability, kind="stable"):
        for angle in candidates.angles:
            grasp = base.at_approach_angles(np.array([pair]), np.array([angle]))
            low, high = GRIPPER.boxes(grasp.width[0]).transpose(1, 0, 2)
            if not (CHECKS.min_width <= grasp.width[0] <= GRIPPER.max_width):
                continue
            steep = -grasp.approach[0] @ scene.plane.normal
            ray = grasp.translation[0] / np.linalg.norm(grasp.translation[0])
            if steep <= np.cos(CHECKS.max_approach_angle):
                continue
            if grasp.approach[0] @ ray <= np.cos(CHECKS.max_hidden_angle):
                continue
            if lowest_height(grasp, GRIPPER, scene.plane)[0] < CHECKS.min_table_distance:
                continue
            local = (around.points - grasp.translation[0]) @ grasp.rotation[0]
            inside = 0
            for lo, hi in zip(low - CHECKS.body_margin, high + CHECKS.body_margin, strict=True):
                inside += around.count[((local > lo) & (local < hi)).all(axis=1)].sum()
            between = (np.abs(local[:, 1]) < low[1, 1]) & (np.abs(local[:, 2]) < high[1, 2])
            between &= (local[:, 0] < high[1, 0]) & (local[:, 0] > low[1, 0])
            height = (high[1, 0] - local[between, 0]).max(initial=0.0)
            if inside <= CHECKS.max_points_inside and height >= CHECKS.min_enclosed:
                found.append((stability[pair], grasp.translation[0], grasp.approach[0]))
    best = max((entry[0] for entry in found), default=0.0)
    return [entry for entry in found if entry[0] >= RANKING.min_stability * best][:96]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("highest", [0.11, 0.03])
def test_the_choice_equals_that_of_checking_every_grasp_against_every_point(seed, highest):
    rng = np.random.default_rng(seed)
    # The plate, unlike the table, is below the lowest gripper.
    plate = Box((0.3, 0.1, 0.012), (0, -0.05, 0))
    neighbor = Box((0.05, 0.05, 0.06), (0.08, 0.02, 0))
    pose, scene, region = seen([Box((0.06, 0.08, 0.1)), neighbor, plate])
    heights = rng.uniform(0.005, highest, 40)
    candidates = replace(
        across_box(pose, heights, rng.normal(0, 0.003), rng.uniform(0.05, 0.09)),
        stability=rng.uniform(0.8, 1.0, 40),
    )
    expected = naive_choice(candidates, region, scene)
    final_pose_alone = changed(
        NARROW, feasibility={"approach_distance": 0.0}, ranking={"nms_distance": 0.0}
    )
    found = chosen(candidates, region, scene, final_pose_alone).grasps
    assert len(expected) == len(found)
    assert len(found) > 0 or highest < 0.1  # no low grasp is free of the plate
    for _, translation, approach in expected:
        away = np.abs(found.translation - translation).max(1)
        away += np.abs(found.approach - approach).max(1)
        assert away.min() < 1e-9


@given(st.integers(0, 2**31))
@settings(max_examples=15, deadline=None)
def test_every_chosen_grasp_opens_wide_enough_and_keeps_over_the_table_on_its_path(seed):
    rng = np.random.default_rng(seed)
    pose, scene, region = SEEN
    size = rng.uniform(0.062, 0.13)  # the box is 6 cm wide
    candidates = across_box(pose, [*rng.uniform(0.0, 0.11, 12), 0.1], size=size)
    found = chosen(candidates, region, scene).grasps
    assert (len(found) > 0) == (size <= GRIPPER.max_width)
    assert (GRIPPER.opening(found.width) <= GRIPPER.max_opening + 1e-12).all()
    for step in np.linspace(0.0, CHECKS.approach_distance, 6):
        on_the_way = replace(found, translation=found.translation - step * found.approach)
        lowest = lowest_height(on_the_way, GRIPPER, scene.plane)
        assert (lowest >= CHECKS.min_table_distance - 1e-9).all()


def test_a_grasp_with_an_obstacle_on_its_approach_path_is_not_chosen():
    at_the_pose_alone = changed(NARROW, feasibility={"approach_distance": 0.0})
    # Behind the gripper at its final pose, and within the length of its approach path.
    bar = Box((0.16, 0.03, 0.02), (0.0, 0.0, 0.25))
    pose, scene, region = seen([Box((0.06, 0.06, 0.12)), bar])
    straight = across_box(pose, [0.1], angles=STRAIGHT)
    assert len(chosen(straight, region, scene, at_the_pose_alone)) == 1
    assert len(chosen(straight, region, scene)) == 0
    aside = chosen(across_box(pose, [0.1]), region, scene)
    assert len(aside) > 0
    assert (-aside.grasps.approach @ pose[:3, 2] < 0.99).all()


def test_the_grasps_of_a_region_differ_and_are_ranked():
    pose, scene, region = SEEN
    candidates = across_box(pose, np.linspace(0.05, 0.11, 25))
    found = chosen(candidates, region, scene)
    near = are_near(found.grasps, RANKING.nms_distance, RANKING.nms_angle)
    assert len(found) > 1
    assert near.sum() == len(found)
    assert (np.diff(found.rank_score) <= 1e-6).all()
    alike = chosen(candidates, region, scene, changed(NARROW, ranking={"nms_distance": 0.0}))
    assert len(alike) > len(found)
    np.testing.assert_array_equal(alike.grasps.rotation[0], found.grasps.rotation[0])


def test_chosen_grasps_stay_within_the_limits():
    pose, scene, region = SEEN
    cone = LimitsConfig(approach_cone=20.0)
    limited = replace(scene, limits=Limits.of(cone, None, scene.plane, CAMERA))
    candidates = across_box(pose, np.linspace(0.05, 0.11, 9))
    free, kept = (chosen(candidates, region, each).grasps for each in (scene, limited))
    steep = np.cos(np.radians(20.0))
    assert (-free.approach @ pose[:3, 2] < steep).any()
    assert len(kept) > 0
    assert (-kept.approach @ pose[:3, 2] >= steep - 1e-9).all()


def test_a_grasp_loses_half_of_its_stability_toward_the_rim_and_no_more_beyond():
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    rim = 0.03 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], 1) + [0.0, 0.0, 0.6]
    disc = RegionCloud(rim, np.tile([0.0, 0.0, -1.0], (60, 1)), np.ones((1, 60), bool))
    middles = np.array([[0.0, 0.0, 0.6], [0.015, 0.0, 0.6], [0.03, 0.0, 0.6], [0.3, 0.0, 0.6]])
    grasps = GraspPoses(np.tile(np.eye(3), (4, 1, 1)), middles, np.full(4, 0.05))
    np.testing.assert_allclose(_centeredness(grasps, disc), [1.0, 0.75, 0.5, 0.5])


def test_the_ranking_orders_the_most_stable_grasps():
    pose, scene, region = SEEN
    candidates, scored = across_box(pose, [0.1, 0.09, 0.08]), []

    def lowest_first(features):
        stability, visible = features.stability, features.visible
        scored.append((len(features.feasible), stability.min() / stability.max(), visible))
        return -scene.plane.height(features.feasible.grasps.translation)

    def ranked(min_stability, most):
        settings = {
            "critic_min_stability": min_stability,
            "max_ranked": most,
            "half_torque_arm": 1e9,  # the weight changes no rank
        }
        return chosen(candidates, region, scene, changed(NARROW, ranking=settings), lowest_first)

    found = ranked(0.5, 40)
    heights = scene.plane.height(found.grasps.translation)
    np.testing.assert_allclose(found.rank_score, -heights)
    assert (np.diff(heights) >= -1e-6).all()
    count, stability, visible = scored[0]
    assert 0 < count <= 40
    assert stability >= 0.5
    assert 0.0 <= visible.min() <= visible.max() <= 1.0
    ranked(0.95, 1)
    assert scored[-1][0] == 1
